#include "orchestrator/jobs/certificate_job.h"

#include <algorithm>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/recording_source.h"
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

Status read_verification(const std::string& path, const ParameterFile& file, Certificate& certificate) {
  if (!path_exists(path)) return {};
  Result<KeyValueFile> conf = KeyValueFile::read(path);
  if (!conf) return conf.error();
  if (conf->has("recording_hash") && conf->text("recording_hash") != file.recording_hash)
    return input_error(path + ": is not of the recording that the parameters are of");
  for (const std::string& key : conf->keys()) certificate.verification.emplace_back(key, conf->text(key));
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
  Result<StationConfig> station = read_station_config(request.station);
  if (!station) return station.error();
  certificate.parties = station->parties;
  certificate.specimen = request.specimen;
  certificate.issued_utc = format_utc(wall_utc_s());
  std::vector<ParameterFile> runs;
  for (const std::string& folder : request.runs) {
    const std::string path = folder + "/" + parameters_name;
    const Result<std::string> text = read_whole_file(path);
    if (!text) return text.error();
    Result<ParameterFile> file = parse_parameter_file(*text, path);
    if (!file) return file.error();
    if (!runs.empty() && file->unit_serial != runs.front().unit_serial)
      return input_error(path + ": of unit " + file->unit_serial + ", expected " + runs.front().unit_serial +
                         ": a certificate is of one unit");
    if (!runs.empty() && file->time_utc < runs.back().time_utc)
      return input_error(path +
                         ": older than the run before it, expected them oldest first: the last one is certified");
    const std::string why = objection(*file);
    if (!why.empty() && !request.specimen)
      return Error{ErrorKind::unit_failed, path + ": no certificate: " + why + " (--specimen makes a specimen)"};
    std::vector<std::string>& hashes = certificate.recording_hashes;
    for (std::string& hash : recordings_of(*file)) {
      if (std::find(hashes.begin(), hashes.end(), hash) != hashes.end())
        return input_error(path + ": recording " + hash + " is given twice: expected runs of different recordings");
      hashes.push_back(std::move(hash));
    }
    certificate.parameters_hash = hash_of_text(*text);
    runs.push_back(std::move(*file));
  }
  certificate.file = runs.back();
  std::array<double, parameter_count> sigma{};
  for (std::size_t i = 0; i < certificate.budget.size(); ++i) {
    certificate.budget[i] = budget_of(runs, i, certificate.parties);
    sigma[i] = certificate.budget[i].expanded() / 2.0;
  }
  Result<VerdictReport> conformity = judge_again(certificate.file, sigma);
  if (!conformity) return input_error(request.runs.back() + "/" + parameters_name + ": " + conformity.error().message);
  certificate.conformity = std::move(*conformity);
  if (Status status = read_verification(request.runs.back() + "/" + verification_name, certificate.file, certificate);
      !status)
    return status.error();
  return certificate_page(certificate);
}

}  // namespace turncal
