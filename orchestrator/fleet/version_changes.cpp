#include "orchestrator/fleet/recalibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "calib/statistics/numerics.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {

namespace {

namespace fs = std::filesystem;

Result<std::set<std::string>> recordings_of(const std::string& version) {
  std::set<std::string> names;
  std::error_code error;
  for (fs::directory_iterator at(version, error), end; at != end && !error; at.increment(error))
    if (at->is_directory() && !at->path().filename().string().starts_with('.'))
      names.insert(at->path().filename().string());
  if (error) return input_error(version + ": cannot read: " + error.message());
  return names;
}

std::string verdict_of(const std::string& folder) {
  if (path_exists(folder + "/" + failure_name)) return "failed";
  const std::string path = folder + "/" + diagnosis_name;
  if (!path_exists(path)) return "not_made";
  Result<KeyValueFile> file = KeyValueFile::read(path);
  return file && file->has("verdict") ? file->text("verdict") : "unreadable";
}

}  // namespace

Result<VersionChanges> compare_versions(const std::string& store, const std::string& from, const std::string& to) {
  VersionChanges changes;
  changes.from = from;
  changes.to = to;
  const std::string old_root = store + "/" + from + "/", new_root = store + "/" + to + "/";
  const std::set<std::string> olds = TRY(recordings_of(old_root));
  const std::set<std::string> news = TRY(recordings_of(new_root));
  std::vector<ParameterChange> all(parameter_count);
  std::vector<std::vector<double>> ratios(parameter_count);
  for (const std::string& name : olds) {
    if (!news.contains(name)) {
      ++changes.only_from;
      continue;
    }
    ++changes.both;
    ++changes.verdicts[{verdict_of(old_root + name), verdict_of(new_root + name)}];
    const std::string old_path = old_root + name + "/" + parameters_name,
                      new_path = new_root + name + "/" + parameters_name;
    if (!path_exists(old_path) || !path_exists(new_path)) continue;
    const ParameterFile before = TRY(read_parameter_file(old_path));
    const ParameterFile after = TRY(read_parameter_file(new_path));
    for (std::size_t k = 0; k < all.size(); ++k) {
      if (!before.sigma[k] || !after.sigma[k] || !(*after.sigma[k] > 0.0) || !(*before.sigma[k] > 0.0)) continue;
      const auto at = Eigen::Index(k);
      const double change = (after.parameters[at] - before.parameters[at]) / *after.sigma[k];
      ParameterChange& c = all[k];
      ++c.recordings;
      c.mean += change;
      c.rms += change * change;
      ratios[k].push_back(*after.sigma[k] / *before.sigma[k]);
      if (std::abs(change) > std::abs(c.largest)) {
        c.largest = change;
        c.largest_unit = after.unit_serial;
        c.largest_recording = name;
      }
    }
  }
  for (const std::string& name : news) changes.only_to += !olds.contains(name);
  for (std::size_t k = 0; k < all.size(); ++k) {
    ParameterChange& c = all[k];
    if (c.recordings == 0) continue;
    c.key = parameter_keys[k];
    c.mean /= double(c.recordings);
    c.rms = std::sqrt(c.rms / double(c.recordings));
    c.sigma_ratio = median(ratios[k]);
    changes.parameters.push_back(std::move(c));
  }
  return changes;
}

Document changes_document(const VersionChanges& c) {
  using namespace cell;
  Document document{"", "From version " + c.from + " to " + c.to};
  document.text(fmt::format("from version {} to {}: {} recordings in both, {} only in the first, {} only in the second",
                            c.from, c.to, c.both, c.only_from, c.only_to));
  Table parameters{
      {name("parameter"), number("mean"), number("rms"), number("largest"), number("sigma ratio"), name("unit")}};
  for (const ParameterChange& p : c.parameters)
    parameters.row({name(p.key), fixed(p.mean, 3), fixed(p.rms, 3), fixed(p.largest, 3), fixed(p.sigma_ratio, 3),
                    name(p.largest_unit)});
  if (!c.parameters.empty()) {
    document.section("parameters", "Change in sigmas of the second");
    document.add(std::move(parameters));
  }
  document.section("verdicts", "Verdicts");
  Table verdicts{{text("first"), text("second"), number("recordings")}};
  for (const auto& [was_is, recordings] : c.verdicts)
    verdicts.row({text(was_is.first), text(was_is.second), count(recordings)});
  document.add(std::move(verdicts));
  return document;
}

}  // namespace turncal
