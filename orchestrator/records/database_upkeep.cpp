// What keeps a results database: its check, and its image for a backup.
#include <sqlite3.h>

#include <cstring>
#include <memory>

#include "orchestrator/records/results_database.h"
#include "orchestrator/records/sqlite_statement.h"

namespace turncal {

Status ResultsDatabase::check() const {
  const auto damaged = [this](const std::string& what) {
    return input_error(path_ + ": results database: damaged: " + what);
  };
  Statement pages(handle_.get(), "PRAGMA integrity_check(1)");
  if (!pages || !pages.row()) return failure("cannot read");
  if (pages.text(0) != "ok") return damaged(pages.text(0));
  Statement references(handle_.get(), "PRAGMA foreign_key_check");
  if (!references) return failure("cannot read");
  if (references.row())
    return damaged("row " + references.text(1) + " of " + references.text(0) + " names a row of " + references.text(2) +
                   " that is not there");
  if (!references.ended_well()) return failure("cannot read");
  const Result<std::vector<StoredCalibration>> calibrations = list({}, "");
  if (!calibrations) return calibrations.error();
  for (const StoredCalibration& c : *calibrations)
    if (!c.defect.empty()) return input_error(c.defect);
  const Result<std::vector<AttemptRecord>> all = attempts({});
  return all ? Status{} : all.error();
}

Result<std::string> ResultsDatabase::image() const {
  sqlite3_int64 size = 0;
  // As one that is read: what is being written is waited for, as with any other statement.
  if (Status status = execute("BEGIN; SELECT count(*) FROM sqlite_master"); !status) return status.error();
  const std::unique_ptr<unsigned char, void (*)(void*)> bytes(sqlite3_serialize(handle_.get(), "main", &size, 0),
                                                              sqlite3_free);
  if (Status status = execute("COMMIT"); !status) return status.error();
  if (!bytes)
    return device_error(path_ + ": results database: there is no memory for its " + std::to_string(size) + " bytes");
  return std::string(reinterpret_cast<const char*>(bytes.get()), static_cast<std::size_t>(size));
}

Result<ResultsDatabase> ResultsDatabase::of_image(const std::string& image, const std::string& path) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(":memory:", &handle, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  ResultsDatabase database(handle, path);
  if (code != SQLITE_OK) return database.failure("cannot open");
  auto* const bytes = static_cast<unsigned char*>(sqlite3_malloc64(image.size()));
  if (!bytes)
    return device_error(path + ": results database: there is no memory for its " + std::to_string(image.size()) +
                        " bytes");
  std::memcpy(bytes, image.data(), image.size());
  const auto size = static_cast<sqlite3_int64>(image.size());
  if (sqlite3_deserialize(handle, "main", bytes, size, size,
                          SQLITE_DESERIALIZE_FREEONCLOSE | SQLITE_DESERIALIZE_RESIZEABLE) != SQLITE_OK)
    return database.failure("cannot read");
  return database;
}

}  // namespace turncal
