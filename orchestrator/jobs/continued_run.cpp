#include "orchestrator/jobs/continued_run.h"

#include <filesystem>

#include "imu_io/base/posix_file.h"
#include "orchestrator/jobs/unit_run.h"
#include "orchestrator/records/journal_file.h"
#include "orchestrator/records/recording_sink.h"

namespace turncal {

Result<RunRequest> continuing(const RunRequest& asked) {
  for (const auto& [option, given] : {std::pair{"--unit", !asked.units.empty()},
                                      {"--station", !asked.station.empty()},
                                      {"--rig", !asked.rig.empty()},
                                      {"--verify", asked.verify},
                                      {"--until-sigma", asked.until_sigma},
                                      {"--partial", asked.partial},
                                      {"--capture-only", asked.capture_only}})
    if (given)
      return input_error(
          std::string(option) +
          ": expected no such option beside --continue, which goes on with the unit and the station of " +
          asked.continues);
  if (asked.sequence.empty()) return input_error("--continue: expected --sequence, what is to be recorded");
  const std::string journal = asked.continues + "/" + journal_name;
  if (!path_exists(journal))
    return input_error(asked.continues + ": holds no " + journal_name + ": expected the folder of a run");
  const JournalContents contents = TRY(read_journal(journal));
  RunRequest request = request_of(contents);
  if (request.units.size() != 1)
    return input_error(asked.continues + ": is a run of " + std::to_string(request.units.size()) +
                       " units: expected a run of one");
  if (!path_exists(asked.continues + "/" + binary_recording_name))
    return input_error(asked.continues + ": holds no " + binary_recording_name +
                       ": expected a run that has recorded all (turncal resume)");
  if (asked.dry_run && !request.dry_run)
    return input_error("--dry-run: expected none, " + asked.continues + " is a run of a real unit");
  request.continues = std::filesystem::absolute(asked.continues).lexically_normal().string();
  request.sequence = asked.sequence;
  request.began_utc.clear();
  request.verified.clear();
  request.verify = request.until_sigma = request.partial = request.capture_only = false;
  request.no_diagnosis = asked.no_diagnosis;
  request.manual = request.manual || asked.manual;
  for (std::string RunRequest::*word : {&RunRequest::operator_name, &RunRequest::part, &RunRequest::lot,
                                        &RunRequest::revision, &RunRequest::ambient, &RunRequest::overdue_reason})
    if (!(asked.*word).empty()) request.*word = asked.*word;
  request.listen = asked.listen;
  request.pace = asked.pace;
  request.verbose = asked.verbose;
  return request;
}

Result<std::vector<LoadedRecording>> recordings_up_to(const std::string& folder) {
  const JournalContents contents = TRY(read_journal(folder + "/" + journal_name));
  std::vector<LoadedRecording> recordings;
  if (const std::string& before = contents.begin_value("continues"); !before.empty()) {
    std::vector<LoadedRecording> earlier = TRY(recordings_up_to(before));
    recordings = std::move(earlier);
  }
  LoadedRecording loaded = TRY(load_recording(folder + "/" + binary_recording_name));
  TRY(check_sealed(loaded, contents, 0));
  recordings.push_back(std::move(loaded));
  return recordings;
}

}  // namespace turncal
