#include "orchestrator/jobs/certificate_job.h"

#include <algorithm>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/run_results.h"
#include "orchestrator/report/certificate.h"
#include "orchestrator/watch/progress.h"

namespace turncal {
namespace {

// Why the result is for nobody's use; empty: it may be certified.
std::string objection(const ParameterFile& file) {
  if (file.simulated) return "its data are simulated";
  if (!is_trusted(file)) return "its sigmas are not trusted";
  for (std::size_t i = 0; i < parameter_keys.size(); ++i)
    if (parameter_is_free[i] && !file.sigma[i])
      return "it has no standard deviation of " + std::string(parameter_keys[i]);
  return "";
}

// A verification belongs to the certificate when it is of these parameters, on this recording, and the one that the verdict knows of.
Status add_verification(const std::string& folder, const ParameterFile& file, Certificate& certificate) {
  const std::string path = folder + "/" + verification_name;
  const std::string* const in_verdict = find_further(file, "verdict.verification");
  if (!path_exists(path)) {
    if (in_verdict == nullptr || in_verdict->find(not_judged_words) != std::string::npos) return {};
    return input_error(path + ": is not there, though the verdict of " + parameters_name + " has a verification");
  }
  VerificationReport report = TRY(read_verification(path));
  const auto other = [&](const std::string& what) {
    return input_error(path + ": is of another " + what + " than " + parameters_name +
                       ": expected the verification of this result (turncal verify --recording judges it again)");
  };
  const std::string calibration = TRY(calibration_hash(file));
  if (report.info.unit_serial != file.unit_serial) return other("unit");
  if (report.recording_hash != file.recording_hash) return other("recording");
  if (report.calibration_hash != calibration) return other("calibration");
  if (in_verdict != nullptr &&
      *in_verdict != std::string(to_string(report.verdict)) + ": " + verification_words(report))
    return other("judgement");
  certificate.verification = std::move(report);
  return {};
}

// Of all recordings that a result was made from.
std::vector<std::string> recordings_of(const ParameterFile& file) {
  std::vector<std::string> hashes;
  const auto of_several = [&] {
    return find_further(file, "record.recording." + std::to_string(hashes.size() + 1) + ".hash");
  };
  while (const std::string* const hash = of_several()) hashes.push_back(*hash);
  if (hashes.empty()) hashes.push_back(file.recording_hash);
  return hashes;
}

}  // namespace

Result<std::string> make_certificate(const CertificateRequest& request) {
  Certificate certificate;
  StationConfig station = TRY(read_station_config(request.station));
  certificate.parties = station.parties;
  certificate.specimen = request.specimen;
  certificate.issued_utc = format_utc(wall_utc_s());
  std::vector<ParameterFile> runs;
  for (const std::string& folder : request.runs) {
    const std::string path = folder + "/" + parameters_name;
    const std::string text = TRY(read_whole_file(path));
    ParameterFile file = TRY(parse_parameter_file(text, path));
    if (!runs.empty() && file.unit_serial != runs.front().unit_serial)
      return input_error(path + ": of unit " + file.unit_serial + ", expected " + runs.front().unit_serial +
                         ": a certificate is of one unit");
    if (!runs.empty() && file.time_utc < runs.back().time_utc)
      return input_error(path +
                         ": older than the run before it, expected them oldest first: the last one is certified");
    const std::string why = objection(file);
    if (!why.empty() && !request.specimen)
      return Error{ErrorKind::unit_failed, path + ": no certificate: " + why + " (--specimen makes a specimen)"};
    std::vector<std::string>& hashes = certificate.recording_hashes;
    for (std::string& hash : recordings_of(file)) {
      if (std::find(hashes.begin(), hashes.end(), hash) != hashes.end())
        return input_error(path + ": recording " + hash + " is given twice: expected runs of different recordings");
      hashes.push_back(std::move(hash));
    }
    certificate.parameters_hash = hash_of_text(text);
    runs.push_back(std::move(file));
  }
  certificate.file = runs.back();
  if (const std::vector<std::string> keys = missing_keys(certificate.file, certificate.parties);
      !keys.empty() && !request.specimen)
    return input_error(request.station + ": no certificate without " + join(keys) + " (--specimen makes a specimen)");
  std::array<double, parameter_count> sigma{};
  for (std::size_t i = 0; i < certificate.budget.size(); ++i) {
    certificate.budget[i] = budget_of(runs, i, certificate.parties);
    sigma[i] = certificate.budget[i].expanded() / 2.0;
  }
  Result<VerdictReport> conformity = judge_again(certificate.file, sigma);
  if (!conformity) return input_error(request.runs.back() + "/" + parameters_name + ": " + conformity.error().message);
  certificate.conformity = std::move(*conformity);
  for (const EffectValue& effect : certificate.file.effects)
    certificate.effect_budget.push_back(budget_of(runs, effect));
  TRY(add_verification(request.runs.back(), certificate.file, certificate));
  return certificate_page(certificate);
}

}  // namespace turncal
