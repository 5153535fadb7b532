// Where a recording contradicts itself, and where the joint estimate therefore cuts the chain.
//
// Two sources: what the Compressor saw on raw samples (gaps of the counter, invalid samples, glitches), and static seconds
// whose innovation nothing explains: nu' S^-1 nu above chi-square's one in 10^9, and ten times what nine in ten of the seconds
// after a rotation show (so that an effect the model lacks, which pushes after every rotation, is not taken for a fault).
// A sample of g lost or counted twice in a rotation shows as a velocity step of gravity x period up or down.
#pragma once

#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

// Faults the raw data show; adds a break for each that matters, in block order.
std::vector<Fault> faults_from_events(const CompressedRecording& recording, std::vector<Break>& breaks);

// In block order.
void add_break(std::vector<Break>& breaks, const Break& cut);

// Finds the worst unexplained second; adds fault and break and returns true, or returns false when there is none.
bool cut_worst_fault(const CompressedRecording& recording, const std::vector<Innovation>& innovations,
                     std::vector<Fault>& faults, std::vector<Break>& breaks);

}  // namespace turncal
