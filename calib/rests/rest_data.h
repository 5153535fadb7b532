// A recording without table angles as rests and the rotations by hand between them.
//
// A rest is a run of static segments, a leg the rotation between two neighbouring rests. Data before the first and
// after the last rest are not used. The rests are verified, whoever found them: each is cut to its longest still
// stretch (calib/statistics/segmentation.h), and one that shakes by more than most_tremor is dropped; what is cut
// belongs to the legs. A leg with lost, invalid or clipped samples has a fault and is set aside. Headings are unknown:
// only gravity ties one rest to the next.
//
// A unit put down by hand creeps. So a leg starts from the direction of gravity in the last second of one rest and ends
// in the first second of the next. The gyros' mean at rest is taken between the middles of these two edges, so that the
// change of tilt seen by the accelerometers can be removed from it (rest_system.h). Compress with
// rest_compression_options(): its static blocks are shorter than the joint estimator's, which keeps the edges sharp.
//
// Sums stay in the recording's own increments. The blocks are not copied: the CompressedRecording must outlive this.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "calib/statistics/compression.h"

namespace turncal {

CompressionOptions rest_compression_options();

// Increments per second over part of a rest.
struct RestMean {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();
  double duration_s = 0.0;  // of the samples that arrived
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
  std::size_t from = 0;  // from rests[from] to rests[from + 1]
  std::size_t first_block = 0;
  std::size_t end_block = 0;
  double duration_s = 0.0;
  std::string fault;  // empty: usable; else the fault and its sample
};

struct RestData {
  const CompressedRecording* recording = nullptr;
  std::vector<Rest> rests;
  std::vector<RestLeg> legs;  // rests.size() - 1
  // White noise per axis, in increments per sqrt(s): half the mean square difference of neighbouring blocks in the
  // rests (Allan), by its median. Zero with fewer than ten differences.
  Eigen::Vector3d gyro_white = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_white = Eigen::Vector3d::Zero();
  std::vector<std::string> notes;  // rests that were cut or set aside: a sentence for all of a kind
};

RestData make_rest_data(const CompressedRecording& recording, double edge_s = 1.0);

}  // namespace turncal
