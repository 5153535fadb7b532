// What a file is, by its first bytes: whoever gives a command the wrong one is told what it is and which command takes it.
//
//   TRY(expect_file(path, FileKind::parameters));
//   // "log.csv: this is a table of numbers (CSV), expected a parameter file; turncal import log.csv --out DIR takes it"
//
// `key = value` text is told by keys that only one kind of it has. Of what is not recognised, or cannot be read, nothing is said: its reader
// finds what is wrong. No more than the first 64 KiB are looked at.
#pragma once

#include <string>
#include <string_view>

#include "calib/types/status.h"

namespace turncal {

enum class FileKind {
  recording,       // .tcr, or a folder with one or with its text form
  recording_part,  // of a text form
  journal,
  statistics,
  parameters,
  diagnosis,
  verification,
  station,
  sequence,
  table_map,  // of import
  frame,
  register_map,
  dialect,
  rig,
  mcap,     // from here to csv: columns of numbers
  rosbag2,  // .db3, or a folder with metadata.yaml
  rosbag1,
  npy,
  mat,
  hdf5,
  csv,
  database,
  json,
  page,        // HTML, PDF
  compressed,  // the whole file
  unknown,
};
inline bool is_table(FileKind kind) { return kind >= FileKind::mcap && kind <= FileKind::csv; }
inline bool is_bag(FileKind kind) { return kind >= FileKind::mcap && kind <= FileKind::rosbag1; }

FileKind recognise_file(const std::string& path);
FileKind recognise_content(std::string_view head);

// An input error where the file, or the folder, is plainly something else. Of tables: where it is no table at all.
Status expect_file(const std::string& path, FileKind wanted);

}  // namespace turncal
