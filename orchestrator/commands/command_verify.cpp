// `turncal verify`: north seeking on the table with a calibration (Wang (2020), 4.2), recorded as a run with verify.seq in place of the
// fourteen steps; `--references`: readings of references against those of the unit (4.3). `turncal certificate` (docs/report.md).
#include <fmt/format.h>

#include <algorithm>

#include "calib/types/status.h"
#include "imu_io/base/console.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/navigation/verification_job.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/certificate.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

struct VerifyOptions {
  RunRequest run;
  std::string unit, parameters, folder, recording, references, format;
  int first_step = 0;
};

// Returns whether an option was given that only a measurement uses.
bool measures(const VerifyOptions& o) {
  return !o.unit.empty() || o.run.dry_run || o.run.manual || !o.run.rig.empty() || !o.run.sequence.empty() ||
         !o.run.operator_name.empty() || !o.run.ambient.empty() || !o.run.session.listen.empty() ||
         o.run.session.pace > 0.0;
}

Status check_together(const VerifyOptions& o) {
  if (!o.references.empty()) {
    if (measures(o) || !o.parameters.empty() || !o.recording.empty() || o.first_step != 0)
      return input_error("--references: expected only --out, --station and --format: the file holds all readings");
    return {};
  }
  if (o.parameters.empty()) return input_error("--parameters is required: the calibration that is verified");
  if (o.folder.empty()) return input_error("--out is required: the folder for " + std::string(verification_name));
  if (o.recording.empty() && o.unit.empty())
    return input_error("--unit is required (or --recording, of a verification that was recorded)");
  if (o.recording.empty() && !o.format.empty())
    return input_error("--format: expected --recording or --references: a measurement prints its progress");
  if (!o.recording.empty() && measures(o))
    return input_error(
        "--recording: expected only --parameters, --out, --station and --from-step: nothing is measured");
  return {};
}

Status verify_by_references(const VerifyOptions& options, CommandContext& context) {
  std::array<double, 3> limit_deg = reference_limits_deg;
  if (!options.run.station.empty()) {
    const VerdictLimits limits = TRY(read_station_config(options.run.station)).limits;
    limit_deg = {limits.heading_deg, limits.level_deg, limits.level_deg};
  }
  const ReferenceReport report = TRY(verify_references(options.references, limit_deg));
  if (!options.folder.empty()) {
    OutputFolder folder = TRY(OutputFolder::prepare(options.folder, {}));
    TRY(write_file_atomically(folder.file("references.conf"), format_references(report)));
    folder.keep();
  }
  context.out << (options.format.empty() ? as_text(reference_document(report))
                                         : key_values_as(options.format, format_references(report)));
  return verification_status(options.references, report.pass ? UnitVerdict::pass : UnitVerdict::fail);
}

// Records the north seeking as a run without calibration. Unusable input is refused before anything moves.
Status measure(const VerifyOptions& options, CommandContext& context) {
  RunRequest run = options.run;
  run.units = {options.unit};
  run.capture_only = run.verify = true;
  run.verified = options.parameters;
  if (run.sequence.empty()) run.sequence = builtin_verify_name;
  return begin_run(run, options.folder, context).status;
}

Status judge_again(const VerifyOptions& options, CommandContext& context) {
  ParameterFile parameters = TRY(read_parameter_file(options.parameters));
  VerdictLimits limits;  // for a real unit without a station: the paper's limits, not those of the rig's gyros
  if (parameters.simulated || !options.run.station.empty())
    limits = TRY(read_station_config(options.run.station)).limits;
  OutputFolder folder = TRY(OutputFolder::prepare(options.folder, {}));
  const VerificationReport report =
      TRY(verify_recording({options.recording, options.parameters, std::move(parameters), limits, options.first_step}));
  const std::string file = folder.file(verification_name);
  const std::string conf = format_verification(report);
  TRY(write_verification(file, report));
  folder.keep();
  if (!printed_as(options.format, conf, context.out)) {
    const LinePrefix marked(context.out,
                            report.info.simulated && context.tag.empty() ? std::string(simulated_tag) : context.tag);
    context.out << as_text(verification_document(report)) << "verification  " << folder.file(verification_page)
                << std::endl;
  }
  return verification_status("unit " + report.info.unit_serial, report.verdict);
}

Status verify(const VerifyOptions& options, CommandContext& context) {
  TRY(check_together(options));
  if (!options.references.empty()) return verify_by_references(options, context);
  return options.recording.empty() ? measure(options, context) : judge_again(options, context);
}

struct CertificateOptions {
  std::vector<std::string>
      runs;             // folders, oldest first: the last result is certified, all of them give the repeatability
  std::string station;  // laboratory.*, customer.*
  std::string html, pdf, check;
  bool specimen = false;
};

// Returns why the result must not be used; empty: it may be certified.
std::string objection(const ParameterFile& file) {
  if (file.simulated) return "its data are simulated";
  if (!is_trusted(file)) return "its sigmas are not trusted: " + why_not_trusted(file);
  for (std::size_t i = 0; i < parameter_keys.size(); ++i)
    if (parameter_is_free[i] && !file.sigma[i]) return "it has no standard deviation of " + parameter_key(i);
  return "";
}

// Adds a verification to the certificate if it is of these parameters, on this recording, and the one that the verdict refers to.
Status add_verification(const std::string& folder, const ParameterFile& file, Certificate& certificate) {
  const std::string path = folder + "/" + verification_name;
  const std::string* const in_verdict = find_further(file, "verdict.verification");
  if (!path_exists(path)) {
    if (in_verdict == nullptr || in_words(*in_verdict).find(not_judged_words) != std::string::npos) return {};
    return input_error(path + ": missing: the verdict of " + parameters_name + " quotes this verification");
  }
  VerificationReport report = TRY(read_verification(path));
  const auto agrees = [&](const std::string& what, const std::string& found, const std::string& expected) -> Status {
    if (found == expected) return {};
    return input_error(path + ": " + what + " '" + found + "': expected '" + expected + "', as in " + parameters_name);
  };
  TRY(agrees("unit", report.info.unit_serial, file.unit_serial));
  TRY(agrees("recording", report.recording_hash, file.recording_hash));
  const std::string calibration = TRY(calibration_hash(file));
  TRY(agrees("calibration", report.calibration_hash, calibration));
  if (in_verdict != nullptr)
    TRY(agrees("result", std::string(to_string(report.verdict)) + ": " + verification_words(report), *in_verdict));
  certificate.verification = std::move(report);
  return {};
}

// Returns the hashes of all recordings of a result.
std::vector<std::string> recordings_of(const ParameterFile& file) {
  std::vector<std::string> hashes;
  const auto of_several = [&] {
    return find_further(file, "record.recording." + std::to_string(hashes.size() + 1) + ".hash");
  };
  while (const std::string* const hash = of_several()) hashes.push_back(*hash);
  if (hashes.empty()) hashes.push_back(file.recording_hash);
  return hashes;
}

// Makes the certificate. Errors: kind input for folders without a result, of several units, of a recording given twice, or in another order;
// unit_failed for results that are simulated or not trusted, unless a specimen is requested.
Result<std::string> make_certificate(const CertificateOptions& options) {
  Certificate certificate;
  StationConfig station = TRY(read_station_config(options.station));
  certificate.parties = station.parties;
  certificate.specimen = options.specimen;
  certificate.issued_utc = format_utc(wall_utc_s());
  std::vector<ParameterFile> runs;
  for (const std::string& folder : options.runs) {
    const std::string path = folder + "/" + parameters_name;
    const std::string text = TRY(read_whole_file(path));
    ParameterFile file = TRY(parse_parameter_file(text, path));
    if (!runs.empty() && file.unit_serial != runs.front().unit_serial)
      return input_error("{}: of unit {}, expected {}: a certificate is of one unit", path, file.unit_serial,
                         runs.front().unit_serial);
    if (!runs.empty() && file.time_utc < runs.back().time_utc)
      return input_error(path + ": older than the run before it: expected the oldest first, the last one is certified");
    if (file.latitude_deg != station.latitude_deg || file.gravity_mps2 != station.gravity_mps2)
      return input_error("{}: latitude {} deg and gravity {} m/s^2: expected those of {}, {} and {}", path,
                         file.latitude_deg, file.gravity_mps2, options.station, station.latitude_deg,
                         station.gravity_mps2);
    const std::string why = objection(file);
    if (!why.empty() && !options.specimen)
      return Error{ErrorKind::unit_failed, path + ": no certificate: " + why + " (--specimen makes a specimen)"};
    std::vector<std::string>& hashes = certificate.recording_hashes;
    for (std::string& hash : recordings_of(file)) {
      if (std::ranges::find(hashes, hash) != hashes.end())
        return input_error(path + ": recording " + hash + " is given twice: expected runs of different recordings");
      hashes.push_back(std::move(hash));
    }
    certificate.parameters_hash = hash_of_text(text);
    runs.push_back(std::move(file));
  }
  certificate.file = runs.back();
  if (const std::vector<std::string> keys = missing_keys(certificate.file, certificate.parties);
      !keys.empty() && !options.specimen)
    return input_error(options.station + ": no certificate without " + join(keys) + " (--specimen makes a specimen)");
  std::array<double, parameter_count> sigma{};
  for (std::size_t i = 0; i < certificate.budget.size(); ++i) {
    certificate.budget[i] = budget_of(runs, i, certificate.parties);
    sigma[i] = certificate.budget[i].expanded() / 2.0;
  }
  Result<VerdictReport> conformity = judge_again(certificate.file, sigma);
  if (!conformity) return input_error(options.runs.back() + "/" + parameters_name + ": " + conformity.error().message);
  certificate.conformity = std::move(*conformity);
  for (const EffectValue& effect : certificate.file.effects)
    certificate.effect_budget.push_back(budget_of(runs, effect));
  TRY(add_verification(options.runs.back(), certificate.file, certificate));
  return certificate_page(certificate);
}

Status certify(const CertificateOptions& options, CommandContext& context) {
  if (!options.check.empty()) {
    if (!options.runs.empty() || !options.station.empty() || !options.html.empty() || !options.pdf.empty())
      return input_error("--check: expected no other option: it reads a certificate that was issued");
    std::string page = TRY(read_whole_file(options.check));
    const std::string hash = TRY(check_certificate(std::move(page), options.check));
    context.out << options.check << ": unaltered, hash " << hash << '\n';
    return {};
  }
  if (options.runs.empty() || options.station.empty() || options.html.empty())
    return input_error("expected the folder of a run, --station and --out; or --check alone");
  TRY(check_apart({{"--station", options.station}, {"--out", options.html}, {"--pdf", options.pdf}}));
  const std::string page = TRY(make_certificate(options));
  constexpr std::size_t alike = 100;
  TRY(check_replaceable(options.html, std::string_view(page).substr(0, alike)));
  if (!options.pdf.empty()) {
    TRY(check_replaceable(options.pdf, "%PDF-"));
    const std::string warning = TRY(write_pdf(page, options.pdf));
    if (!warning.empty()) context.out << options.pdf << ": " << warning << '\n';
  }
  TRY(write_file_atomically(options.html, page));
  context.out << "certificate  " << options.html << '\n';
  if (!options.pdf.empty()) context.out << "pdf          " << options.pdf << '\n';
  return {};
}

}  // namespace

void add_verify_command(CommandLine& line) {
  const auto [command, options] = line.command<VerifyOptions>(
      "verify", "check a calibration by north seeking, or compare attitude readings with references", verify);
  RunRequest& run = options.run;
  command.option("--parameters", options.parameters, "parameter file of the unit");
  command.option("--unit", options.unit, "serial number of the unit");
  command.option("--out", options.folder, "folder for the recording, verification.conf and verification.html");
  command.option("--station", run.station, "station configuration, with its limits; default: the built-in rig station");
  command.flag("--dry-run", run.dry_run, "simulate table and unit, in virtual time");
  command.flag("--manual", run.manual, "turn the table by hand");
  command.option("--rig", run.rig, "rig configuration (docs/rig.md); default: the built-in one");
  command.option("--sequence", run.sequence, "sequence instead of verify.seq: align sets the zero, a dwell is judged");
  command.option("--recording", options.recording, "judge an earlier recording; nothing moves");
  command.option("--from-step", options.first_step, {is::in(0, 1'000'000)},
                 "with --recording: step at which the north seeking begins, after a calibration");
  command.option("--references", options.references,
                 "CSV of readings: heading_deg, roll_deg, pitch_deg and the same with the prefix reference_");
  command.format(options.format, "with --recording or --references: print the result in this form instead of text");
  add_watch_options(command, run);
  add_record_options(command, run);
}

void add_certificate_command(CommandLine& line) {
  const auto [command, options] =
      line.command<CertificateOptions>("certificate", "write the calibration certificate of a unit", certify);
  command.option("run", options.runs, "folders of runs of one unit, oldest first; the last run is certified");
  command.option("--station", options.station, "station configuration, with laboratory.* and customer.*");
  command.option("--out", options.html, "HTML file to write");
  command.option("--check", options.check, "check that an issued certificate is unaltered");
  command.option("--pdf", options.pdf, "PDF file to write (needs weasyprint)");
  command.flag("--specimen", options.specimen,
               "write a specimen with a watermark, even of simulated or untrusted results");
}

}  // namespace turncal
