// The recordings of an archive: those of a list, all below a folder, or those of a results database, where its rows say that they are.
//
// A list is CSV with a header: `recording`, a path (relative ones from the list's folder), and, where they are known, `station`, `lot`, `part`,
// `revision` and `measured_utc`. Below a folder every recording counts: a .tcr file, or a folder in text form. What a run says of itself
// in the parameters.conf beside its recording is taken over where the list does not say it (whole_record), when its turn has come.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

struct ArchiveEntry {
  std::string recording;
  std::map<std::string, std::string> record;  // "station" -> "line 1", ...: record.* keys of the parameter file
};

inline const std::vector<std::string> archive_columns = {"station", "lot", "part", "revision", "measured_utc"};

// In the order of the list or of the rows, or by path. Errors: no such file, a header without `recording`, a column that is not known, a row that is too long
// or too short, not one recording.
Result<std::vector<ArchiveEntry>> read_archive(const std::string& path);

// What is known of a recording: by the list, and by the run.
std::map<std::string, std::string> whole_record(const ArchiveEntry& entry);

// As a list, with absolute paths. An error where a path or value cannot stand in one: a comma, a line break.
Result<std::string> format_archive(const std::vector<ArchiveEntry>& entries);

}  // namespace turncal
