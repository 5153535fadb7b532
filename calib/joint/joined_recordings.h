// Several recordings of one unit as one: one behind the other, with six columns for every one after the first.
//
// Scale factors, installation and effects are common. Between two recordings the chain of attitude is cut and the biases' wander begins
// anew (Break::begins_recording); what the biases of recording k have beside those of the first is six effects, the turn-on columns,
//   bias of recording k = bias of the first + turn-on of k
// Effects of the time since a run began (EffectEntry::of_one_run) have a column for every recording, and time counts from its own first sample.
// So everything that is done with one recording is done with several.
#pragma once

#include <optional>
#include <vector>

#include "calib/joint/several_recordings.h"

namespace turncal {

struct JoinedRecordings {
  std::vector<const CompressedRecording*> parts;
  CompressedRecording data;
  std::vector<std::size_t> begins;     // first block of every part but the first
  std::vector<EffectColumn> turn_ons;  // six for every part but the first
};
// REQUIRES: at least one; of one unit, one site and one kind of increment.
JoinedRecordings join_recordings(const std::vector<const CompressedRecording*>& parts);

bool is_turn_on(const EffectColumn& column);
bool is_gyro_turn_on(const EffectColumn& column);

// Each by itself is fitted to its noise and all together, at `together`, are not: then what `combine_recordings` says of them, if that is that
// they disagree.
std::optional<SeveralRecordings> contradiction(const JoinedRecordings& recordings, const JointResult& together);

// Of an estimate of several recordings what is the unit's: biases are the mean over the recordings, with the scatter of the mean in their
// sigma; effects of one run are those of the first. The rest goes into what is returned. `also`: another covariance of the same estimate.
struct OfEachRecording {
  TurnOns turn_ons;
  std::vector<EstimatedEffect> effects;  // of one run, of a recording after the first
};
OfEachRecording leave_what_is_common(JointResult& estimate, std::size_t recordings, Eigen::MatrixXd* also = nullptr);

}  // namespace turncal
