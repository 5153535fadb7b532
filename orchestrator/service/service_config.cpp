#include "orchestrator/service/service_config.h"

#include <algorithm>

#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "orchestrator/station/database_name.h"

namespace turncal {

Result<ServiceConfig> read_service_config(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  const auto beside = [&path](const std::string& name) {
    return name.empty() || name.front() == '/' ? name : folder_of(path) + "/" + name;
  };
  ServiceConfig config;
  for (int number = 1; number == 1 || file.has("station." + std::to_string(number)); ++number) {
    const std::string key = "station." + std::to_string(number);
    ServedStation station{.name = file.text(key),
                          .queue = beside(file.text(key + ".queue")),
                          .runs = beside(file.text(key + ".runs")),
                          .mounted = beside(file.text_or(key + ".mounted", ""))};
    const auto same = [&station](const ServedStation& other) { return other.name == station.name; };
    if (std::any_of(config.stations.begin(), config.stations.end(), same)) file.reject(key, "a name of its own");
    config.stations.push_back(std::move(station));
  }
  config.password_file = beside(file.text_or("serve.password_file", ""));
  config.database = file.text_or("serve.database", "");
  if (!names_a_server(config.database)) config.database = beside(config.database);
  TRY(file.check_all_used());
  TRY(check_database_name(config.database));
  return config;
}

}  // namespace turncal
