// The recording that an ideal unit without noise would make of a planned run: what `turncal predict` estimates from.
//
// One axis turns at a time, so over a move the rate of the table is a vector u fixed in the body:
//   heading  u = -C_bn U        pitch  u = Rx(-R) z        roll  u = x            (C_nb = Ry(-H) Rz(P) Rx(R))
// and with theta(t) the angle turned so far (trapezoid of rate, or triangle when the rate is never reached)
//   C_nb(t) = C_nb(0) Exp(theta u),   w_b = theta' u + C_bn w_ie,   f_b = C_bn (0, g, 0)
// The increments of a sample are the integrals of w_b and f_b over it (two-point Gauss; error below 1e-9 m/s in a
// sample in which the acceleration changes, far less elsewhere). The pulses follow from the parameters of the unit:
// counts = n^-1 (dtheta + N0 dt), a^-1 (dv + A0 dt), real numbers, not rounded. At rest every sample is the same.
//
// Units: degrees, deg/s and deg/s^2 of the table at the border, SI inside. The table is level, square and points as told.
// Not modelled: table errors, quantisation of the counts, noise, effects, repeated dwells.
#pragma once

#include <optional>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"
#include "calib/types/axis.h"
#include "calib/types/recording_types.h"

namespace turncal {

struct PlannedMotion {
  AxisTriple start_deg;                  // where the table stands at the first sample
  std::vector<PlannedMotionItem> items;  // in order
};

struct TemperatureProfile {  // T = start + rise (1 - exp(-t/tau))
  double start_c = 24.0;
  double rise_c = 0.0;
  double tau_s = 2400.0;
};

// REQUIRES an invertible n and a, gravity above zero, and moves that begin where the axis stands.
// Without a temperature profile the recording has none, whatever info says.
CompressedRecording planned_recording(const RecordingInfo& info, const PlannedMotion& motion, const Parameters& unit,
                                      const std::optional<TemperatureProfile>& temperature = {});

// Return the angle turned after t seconds of a move by `angle_deg` (sign included), and the duration of the move without settling.
double trapezoid_angle_deg(double angle_deg, double rate_degps, double acceleration_degps2, double t_s);
double trapezoid_duration_s(double angle_deg, double rate_degps, double acceleration_degps2);

}  // namespace turncal
