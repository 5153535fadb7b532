#include "orchestrator/fleet/version_changes.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <set>

#include "calib/statistics/distributions.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/fleet/recalibration.h"
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
      const auto at = static_cast<Eigen::Index>(k);
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
    c.mean /= static_cast<double>(c.recordings);
    c.rms = std::sqrt(c.rms / static_cast<double>(c.recordings));
    c.sigma_ratio = median(ratios[k]);
    changes.parameters.push_back(std::move(c));
  }
  return changes;
}

std::vector<std::string> describe(const VersionChanges& c) {
  std::vector<std::string> lines;
  lines.push_back("from version " + c.from + " to " + c.to + ": " + std::to_string(c.both) + " recordings in both, " +
                  std::to_string(c.only_from) + " only in the first, " + std::to_string(c.only_to) +
                  " only in the second");
  char text[200];
  if (!c.parameters.empty())
    lines.emplace_back("parameter   mean      rms  largest  (sigmas of the second)   sigma ratio   unit");
  for (const ParameterChange& p : c.parameters) {
    std::snprintf(text, sizeof text, "%-8s %8.3f %8.3f %8.3f  %35.3f   %s", p.key.c_str(), p.mean, p.rms, p.largest,
                  p.sigma_ratio, p.largest_unit.c_str());
    lines.emplace_back(text);
  }
  for (const auto& [verdicts, count] : c.verdicts) {
    std::snprintf(text, sizeof text, "%-12s -> %-12s %6zu", verdicts.first.c_str(), verdicts.second.c_str(), count);
    lines.emplace_back(text);
  }
  return lines;
}

}  // namespace turncal
