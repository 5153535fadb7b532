// For tests of `turncal navigate`: a unit at rest, and its true parameters or nearly.
#pragma once

#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {

class Navigate : public RigUnit {
 protected:
  // 300 s and 1700 s at rest at a heading of 30 deg, with a turn over and back in the middle, of a unit without noise.
  void record_rest(const std::string& out, const std::string& rig = "") {
    record(out, std::string(without_noise) + "seed = 31\n" + rig,
           "step 1\n  initial H 30 P 0 R 0\n  align 60000\n  dwell 140000\n  rotate P +90\n  dwell 60000\n"
           "  rotate P -90\n  dwell 140000\n");
  }
  // And its true parameters.
  void record_rest_and_truth() {
    record_rest("rest");
    write_truth("rest", "true.conf");
  }
  // The true parameters as a file, but for `change` of one of them.
  void write_truth(const std::string& recording, const std::string& name, int parameter = 0, double change = 0.0) {
    ParameterFile file = truth_of(recording);
    file.parameters[parameter] += change;
    keep(file, name);
  }
};

}  // namespace turncal
