// The page of `turncal serve`: all stations, GET / and GET /status.json, GET /metrics for Prometheus; GET /unit/SERIAL and
// GET /report/STATION/FOLDER/FILE for what there is of a unit and of a run. With a password file POST /act, too.
//
// A thread of its own looks at the stations once a second, so that what a client asks for is there already, and a slow disk holds up
// nobody but that thread; the page shows how old the look is. Another reads the results database every ten seconds, if there is one. Pages of
// units and runs are made by a third when they are asked for, and kept for ten seconds: whoever asks first is told to ask again. Posts are answered one after the other, at most one password in
// between_passwords_s: guessing is slow. A name and password that were right once do not wait, nor does a stop: its password is looked at whatever
// others do, so that by stops passwords can be tried as fast as crypt(5) hashes.
//
// POST /act: Authorization: Basic, X-Turncal: 1, and a body of key = value lines: station, action, unit (station_view.h), values with %xx. Answers: 200 and what
// was done; 401 name or password; 409 what cannot be done now, and why; 429 too soon.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/service/station_view.h"

namespace turncal {

class ServicePage {
 public:
  // address: as of page_server.h. With a password file only a loopback one: names and passwords are not encrypted.
  static Result<std::unique_ptr<ServicePage>> open(const std::string& address, const ServiceConfig& config,
                                                   std::function<double()> now_utc_s);
  ~ServicePage();
  ServicePage(const ServicePage&) = delete;
  ServicePage& operator=(const ServicePage&) = delete;

  std::string url() const;
  bool loopback() const;

 private:
  ServicePage();
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace turncal
