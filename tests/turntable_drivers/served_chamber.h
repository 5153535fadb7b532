// For tests of chambers: a rig, its chamber, a twin that shows it as a real one, a server in a thread of its own, and the driver.
#pragma once

#include "tests/test.h"
#include "tests/turntable_drivers/serving.h"
#include "turntable_drivers/twins/chamber_twin.h"
#include "turntable_drivers/twins/rig_chamber.h"

namespace turncal {

inline std::string own_chamber_text(const std::string& name, const std::string& kind) {
  return replaced(file_text(TURNCAL_SOURCE_DIR "/tests/turntable_drivers/chambers/" + name + ".chamber"),
                  "link.kind = tcp", "link.kind = " + kind);
}
inline std::string registers_text(const std::string& kind) { return own_chamber_text("registers", kind); }
inline std::string sentences_text(const std::string& kind) { return own_chamber_text("sentences", kind); }

struct ServedChamber {
  explicit ServedChamber(const std::string& text, const RigConfig& config = default_rig_config())
      : described(expect_value(parse_chamber(text, "own.chamber"))),
        group(config, 1),
        simulated(group, described.limits),
        twin(described, simulated) {
    EXPECT_OK(described.link().tcp ? twin.listen_tcp(0) : twin.open_pty(""));
    described.reach(twin.address());
    driver = std::make_unique<DescribedChamber>(described);
    serving_.emplace(twin);
  }
  ~ServedChamber() { driver.reset(); }
  void pass(double seconds) {
    const std::lock_guard lock(twin.mutex);
    group.pass_until(group.now_s() + seconds);
  }
  void disturb(std::function<void(bool, AnswerPlan&)> how) {
    serving_->change([&] { twin.disturb = std::move(how); });
  }
  void hang_up() {
    serving_->change([&] { twin.hang_up(); });
  }
  bool heats() {
    const std::lock_guard lock(twin.mutex);
    return group.rig(0).chamber().on;
  }

  ChamberDescription described;
  RigGroup group;
  RigChamber simulated;
  ChamberTwin twin;
  std::unique_ptr<DescribedChamber> driver;

 private:
  std::optional<Serving> serving_;
};

}  // namespace turncal
