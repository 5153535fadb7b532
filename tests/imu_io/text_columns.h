// A table in memory, as the program reads one from a file.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "imu_io/recordings/csv_map_import.h"

namespace turncal {

inline ColumnSource columns_of_text(std::string content, const std::string& name) {
  ColumnSource source;
  source.file_name = name;
  source.head = content;
  source.read = [held = std::make_shared<const std::string>(std::move(content)), name](
                    const std::vector<WantedColumn>& wanted, const TableFormat& format, const TableSink& sink) {
    return read_number_table(bytes_of_text(*held), name, wanted, format, sink);
  };
  return source;
}

inline Result<CsvImport> import_text(const CsvMap& map, const std::string& csv) {
  return import_columns(map, columns_of_text(csv, "d.csv"));
}

}  // namespace turncal
