// Where a recording holds what the fourteen steps need: segments found by step number and commanded angles, and the
// measurements taken there. Before anything is computed the data are held against the segment list, so that a wrong
// list gives one clear line and not wrong parameters. Errors are of kind input; see closed_form.h.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/closed_form/closed_form_formulas.h"
#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"
#include "calib/types/status.h"

namespace turncal {

class ClosedFormLayout {
 public:
  // The recording must outlive the layout.
  ClosedFormLayout(const CompressedRecording& recording, double min_dwell_s, double max_misfit_deg);

  // First of all: site, steps, dwells and legs. After an error nothing else may be called.
  Status find();
  // Every segment and leg that was found: long enough, at rest, the right way up, nothing lost on the way, turned as
  // commanded. `model` may be as wrong as start_parameters().
  Status check_data(const SensorModel& model) const;

  StepMeasurement measure(int step, const SensorModel& model) const;

 private:
  // A leg in the segment list, and how the table turns on the way: about one axis, given in the body.
  struct Leg {
    std::size_t from = 0;
    std::size_t to = 0;
    double turn_deg = 0.0;
    Eigen::Vector3d axis_b = Eigen::Vector3d::Zero();
  };

  Status check_site() const;
  std::optional<std::size_t> find_static(const VerticalSpec& spec) const;
  std::optional<Leg> find_leg(int step, const LegSpec& spec) const;
  Status check_static(std::size_t segment, const SensorModel& model) const;
  Status check_way(const Leg& leg, const SensorModel& model) const;
  LegMotion navigate(const Leg& leg, const SensorModel& model) const;
  std::string place(std::size_t segment) const;

  const CompressedRecording& recording_;
  const double min_dwell_s_;
  const double max_misfit_deg_;
  const std::vector<std::size_t> first_block_;
  std::vector<std::size_t> verticals_;  // segments, in the order of closed_form_verticals
  std::vector<std::vector<Leg>> legs_;  // by step number
};

}  // namespace turncal
