#include "imu_io/base/file_kind.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <vector>

#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

using namespace std::string_view_literals;

struct KindRow {
  FileKind kind;
  std::string_view what, taken;          // taken: which command takes it; {} is the file
  std::string_view beginning = {};       // first bytes of the file
  std::string_view key = {}, also = {};  // keys that identify a text file
};
constexpr std::string_view by_import = "turncal import {} --out DIR takes it";
constexpr std::string_view by_nothing = "no command takes it";

// In the order of FileKind.
constexpr KindRow kind_rows[] = {
    {FileKind::recording, "a recording of turncal",
     "turncal calibrate, diagnose, apply, allan, navigate and export take it", "\x89TCR"},
    {FileKind::recording_part, "a part of a recording", "turncal calibrate, diagnose, apply and export take its folder",
     "", "format", "gyro_increment"},
    {FileKind::journal, "the journal of a run", "turncal journal and resume take its folder", "\x89TCJ"},
    {FileKind::statistics, "statistics of a calibration", "turncal fleet takes the store that it is in", "TCST"},
    {FileKind::parameters, "a parameter file", "turncal convert and --parameters of apply, navigate and verify take it",
     "", "N01", "checksum"},
    {FileKind::diagnosis, "the result of a diagnosis", by_nothing, "", "verdict", "quality.trusted"},
    {FileKind::verification, "the result of a verification", by_nothing, "", "verdict.result"},
    {FileKind::station, "a station file", "--station of run, check and monitor takes it", "", "table.driver"},
    {FileKind::sequence, "a sequence", "--sequence of run, check and predict takes it", "", "rate_degps",
     "acceleration_degps2"},
    {FileKind::table_map, "a map of columns", "--map of import takes it", "", "gyro.columns", "accel.columns"},
    {FileKind::frame, "a frame description", "--frame of import and imu.frame of a station take it", "", "sync",
     "sample_period_s"},
    {FileKind::register_map, "a register map", "table.map of a station file takes it", "", "link.kind", "write.stop"},
    {FileKind::dialect, "a dialect of a table", "table.dialect of a station file takes it", "", "link.kind",
     "link.terminator_in"},
    {FileKind::rig, "a rig file", "--rig of run --dry-run and rig.file of a station take it", "", "seed"},
    {FileKind::mcap, "an MCAP file", by_import, "\x89MCAP"},
    {FileKind::rosbag2, "a rosbag2 file", by_import},
    {FileKind::rosbag1, "a rosbag1 file", by_import, "#ROSBAG V"},
    {FileKind::npy, "a NumPy array", by_import, "\x93NUMPY"},
    {FileKind::mat, "a MATLAB file", by_import, "MATLAB "},
    {FileKind::hdf5, "an HDF5 file", by_import, "\x89HDF\r\n\x1a\n"},
    {FileKind::csv, "a table of numbers (CSV)", by_import},
    {FileKind::database, "an SQLite database", "turncal history, shift and records take a results database",
     "SQLite format 3\0"sv},
    {FileKind::json, "JSON", by_nothing},
    {FileKind::page, "a page to read", by_nothing, "%PDF"},
    {FileKind::compressed, "a compressed file",
     "decompress it first (save a table of an .xlsx file as CSV, an array of an .npz file as .npy)",
     "\x28\xB5\x2F\xFD"},
};
constexpr std::string_view also_compressed[] = {"\x1f\x8b", "\x04\x22\x4D\x18", "BZh", "PK\x03\x04", "\xFD\x37zXZ"};

const KindRow& row_of(FileKind kind) { return kind_rows[std::size_t(kind)]; }

// Returns the keys of `key = value` text up to the first step of a sequence; none when a line is something else.
std::vector<std::string_view> keys_of(std::string_view text) {
  std::vector<std::string_view> keys;
  while (!text.empty()) {
    const std::string_view line = trimmed(next_line(text));
    const std::size_t equals = line.find('=');
    if (line.starts_with("step ")) break;
    if (line.empty() || line.starts_with('#')) continue;
    if (equals == std::string_view::npos) return {};
    keys.push_back(trimmed(line.substr(0, equals)));
  }
  return keys;
}

// True when one of the first hundred lines has at least three numbers, which make up at least half of its cells.
bool has_row_of_numbers(std::string_view text) {
  const auto is_number = [](std::string_view cell) { return device_number(cell, true).has_value(); };
  std::vector<std::string_view> cells;
  const auto is_row = [&] {
    const auto numbers = std::size_t(std::ranges::count_if(cells, is_number));
    return numbers >= 3 && 2 * numbers >= cells.size();
  };
  for (int line = 0; line < 100 && !text.empty(); ++line) {
    const std::string_view row = next_line(text);
    for (const char separator : {',', ';', '\t', ' '}) {
      split_cells(row, separator, cells);
      if (is_row()) return true;
    }
  }
  return false;
}

}  // namespace

FileKind recognise_content(std::string_view head) {
  for (const KindRow& row : kind_rows)
    if (!row.beginning.empty() && head.starts_with(row.beginning))
      return row.kind == FileKind::database && head.find("serialization_format") != head.npos ? FileKind::rosbag2
                                                                                              : row.kind;
  if (std::ranges::any_of(also_compressed, [&](auto bytes) { return head.starts_with(bytes); }))
    return FileKind::compressed;
  if (head.find('\0') != head.npos) return FileKind::unknown;
  const std::vector<std::string_view> keys = keys_of(head);
  for (const KindRow& row : kind_rows)
    if (!row.key.empty() && std::ranges::count(keys, row.key) > 0 &&
        (row.also.empty() || std::ranges::count(keys, row.also) > 0))
      return row.kind;
  if (!keys.empty()) return FileKind::unknown;
  const std::string_view text = head.substr(std::min(head.find_first_not_of(" \t\r\n"), head.size()));
  if (text.starts_with('{') || text.starts_with("[{")) return FileKind::json;
  if (text.starts_with("<!doctype html") || text.starts_with("<!DOCTYPE html")) return FileKind::page;
  return has_row_of_numbers(head) ? FileKind::csv : FileKind::unknown;
}

FileKind recognise_file(const std::string& path) {
  struct stat facts {};
  if (::stat(path.c_str(), &facts) == 0 && S_ISDIR(facts.st_mode)) {
    if (path_exists(path + "/recording.tcr") || path_exists(path + "/recording.conf")) return FileKind::recording;
    return path_exists(path + "/metadata.yaml") ? FileKind::rosbag2 : FileKind::unknown;
  }
  const Result<PosixFile> file = PosixFile::open_to_read(path);
  if (!file) return FileKind::unknown;
  std::string head(std::size_t{1} << 16, '\0');
  const Result<std::size_t> size = file->read_at(0, std::as_writable_bytes(std::span(head)));
  if (!size) return FileKind::unknown;
  const bool whole = *size < head.size();
  head.resize(*size);
  if (const std::size_t last = head.rfind('\n'); !whole && last != head.npos) head.resize(last + 1);
  return recognise_content(head);
}

Status expect_file(const std::string& path, FileKind wanted) {
  const FileKind kind = recognise_file(path);
  if (kind == FileKind::unknown || kind == wanted || (is_table(wanted) && is_table(kind))) return {};
  return input_error("{}: this is {}, expected {}; {}", path, row_of(kind).what, row_of(wanted).what,
                     fmt::format(fmt::runtime(row_of(kind).taken), shell_path(path)));
}

}  // namespace turncal
