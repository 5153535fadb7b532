// Recognises a file by its first bytes. A command given the wrong file says what it is and which command takes it.
//
//   TRY(expect_file(path, FileKind::parameters));
//   // "log.csv: this is a table of numbers (CSV), expected a parameter file; turncal import log.csv --out DIR takes it"
//
// Text of `key = value` lines is recognised by keys that only one kind has. An unrecognised or unreadable file is no error here: its reader
// reports what is wrong. Only the first 64 KiB are read.
#pragma once

#include <string>
#include <string_view>

#include "calib/types/status.h"

namespace turncal {

enum class FileKind {
  recording,       // .tcr, or a folder with recording.tcr or recording.conf
  recording_part,  // one file of the text form
  journal,
  statistics,
  parameters,
  diagnosis,
  verification,
  station,
  sequence,
  table_map,  // an import map
  frame,
  register_map,
  dialect,
  rig,
  mcap,     // mcap to csv are tables of numbers
  rosbag2,  // .db3, or a folder with metadata.yaml
  rosbag1,
  npy,
  mat,
  hdf5,
  csv,
  database,
  json,
  page,        // HTML, PDF
  compressed,  // the file as a whole
  unknown,
};
inline bool is_table(FileKind kind) { return kind >= FileKind::mcap && kind <= FileKind::csv; }
inline bool is_bag(FileKind kind) { return kind >= FileKind::mcap && kind <= FileKind::rosbag1; }

FileKind recognise_file(const std::string& path);
FileKind recognise_content(std::string_view head);

// Returns an input error when the file or folder is clearly of another kind. Any table of numbers passes for any other.
Status expect_file(const std::string& path, FileKind wanted);

}  // namespace turncal
