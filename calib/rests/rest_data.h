// A recording without table angles, seen as rests and the rotations by hand between them.
//
// A rest is a run of static segments, a leg the rotation between two neighbouring rests. What comes before the first
// and after the last rest is not used. Whoever found the rests, they are verified: each is cut to the longest stretch that stands
// still (calib/statistics/segmentation.h), and one that shakes by more than most_tremor is none; what is cut belongs to the legs. A leg
// with lost, invalid or clipped samples has a fault and is set aside. Headings are unknown: only gravity ties one rest to the next.
//
// A unit that was put down by hand creeps, so a leg starts from the direction of gravity in the last second of one rest
// and ends in the first second of the next, and the gyros' mean at rest is taken between the middles of these two
// edges, so that the tilt the accelerometers see in between can be taken off it (rest_system.h). Compress with
// rest_compression_options(): shorter static blocks than the joint estimator's, so that the edges are sharp.
//
// Sums stay in the recording's own increments; the blocks stay where they are: the CompressedRecording must outlive
// this.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "calib/statistics/compression.h"

namespace turncal {

CompressionOptions rest_compression_options();

// Increments a second over part of a rest.
struct RestMean {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();
  double duration_s = 0.0;  // of samples that came
  std::size_t first_block = 0;
  std::size_t end_block = 0;  // exclusive
};

struct Rest {
  RestMean whole;
  RestMean first_edge;
  RestMean last_edge;
  Eigen::Vector3d gyro_between =
      Eigen::Vector3d::Zero();  // increments a second, middle of first_edge to middle of last
  double between_s = 0.0;
  double start_s = 0.0;  // from the first sample of the recording
};

struct RestLeg {
  std::size_t from = 0;  // rests[from] to rests[from + 1]
  std::size_t first_block = 0;
  std::size_t end_block = 0;
  double duration_s = 0.0;
  std::string fault;  // empty: usable; else what came, and at which sample
};

struct RestData {
  const CompressedRecording* recording = nullptr;
  std::vector<Rest> rests;
  std::vector<RestLeg> legs;  // rests.size() - 1
  // White noise, measured as half the variance of the difference of neighbouring blocks in the rests (Allan); per axis,
  // in increments per sqrt(s). Zero when there are fewer than ten differences.
  Eigen::Vector3d gyro_white = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_white = Eigen::Vector3d::Zero();
  std::vector<std::string> notes;  // rests that were cut or set aside: a sentence for all of a kind
};

RestData make_rest_data(const CompressedRecording& recording, double edge_s = 1.0);

}  // namespace turncal
