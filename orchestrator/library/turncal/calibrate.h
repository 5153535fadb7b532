// `turncal calibrate`: the 24 parameters with standard deviations, from one recording or several of one unit.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <turncal/parameters.h>
#include <turncal/recording.h>
#include <turncal/report.h>

namespace turncal::v0 {

struct CalibrateOptions {
  std::string method = "joint";  // or closed-form: the fourteen steps of Wang (2020)
  bool partial = false;          // undetermined parameters are no error
  std::string time_utc = {};     // for the record, as 2026-01-31T12:00:00Z; empty: now
};

struct Calibration {
  Parameters parameters;
  std::vector<std::string> notes;  // defects of the data, course of the solution
  std::string distrust;  // what speaks against the sigmas, for which the program exits with 20; empty: nothing
  Report report;
};

TURNCAL_API Calibration calibrate(std::span<const Recording> recordings, const CalibrateOptions& options = {});
inline Calibration calibrate(const Recording& recording, const CalibrateOptions& options = {}) {
  return calibrate(std::span(&recording, 1), options);
}

}  // namespace turncal::v0
