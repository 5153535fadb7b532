// A live run by hand: the rig's unit on a pseudo-terminal, and a person who turns the rig and types.
#include <thread>

#include "imu_io/frames/frame_description.h"
#include "imu_io/lines/unit_end.h"
#include "imu_io/units/frame_streamer.h"
#include "tests/orchestrator/operator_session.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_devices.h"

namespace turncal {
namespace {

constexpr double speed_up = 20.0;

// The unit, from when somebody listens.
class ServedUnit {
 public:
  explicit ServedUnit(const std::string& link) : rig_(default_rig_config()), unit_(rig_) {
    Result<Pty> line = Pty::create(link);
    EXPECT_TRUE(line.ok());
    line_ = std::move(*line);
    const auto frame = read_frame_description(std::string(TURNCAL_SOURCE_DIR) + "/imu_io/frames/laser_gyro.frame");
    EXPECT_TRUE(frame.ok());
    streamer_ = std::make_unique<FrameStreamer>(unit_, *frame, line_, speed_up, 1.0);
    thread_ = std::thread([this] { serve(); });
  }
  ~ServedUnit() {
    done_ = true;
    thread_.join();
  }
  // As a hand does: returns when the axis stands.
  void turn(Axis axis, double angle_deg, double rate_degps) {
    {
      const std::lock_guard lock(mutex_);
      rig_.command_move(axis, angle_deg, rate_degps, 10.0);
    }
    for (const Deadline deadline(60.0); !deadline.passed(); ::usleep(5000)) {
      const std::lock_guard lock(mutex_);
      if (!rig_.axis(axis).moving) return;
    }
    ADD_FAILURE() << "the rig's time does not pass";
  }

 private:
  void serve() {
    bool started = false;
    for (; !done_; ::usleep(1000)) {
      const std::lock_guard lock(mutex_);
      if (!started && line_.has_peer()) {
        started = true;
        EXPECT_TRUE(streamer_->start(monotonic_s()).ok());
      } else if (started) {
        EXPECT_TRUE(streamer_->pump(monotonic_s()).ok());
      }
    }
  }
  Rig rig_;
  RigImu unit_;
  Pty line_;
  std::unique_ptr<FrameStreamer> streamer_;
  std::mutex mutex_;
  std::atomic<bool> done_ = false;
  std::thread thread_;
};

class ByHandLive : public OperatedProgram {};

TEST_F(ByHandLive, WholeRunWithAWrongAxisASlowTurnAndALeave) {
  write("short.seq",
        "format = 1\nname = short\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1 \"up\"\n  initial H 0 P 0 R 0\n"
        "  align 1000\n  rotate P +90\n  dwell 1000\n  rotate R -90\n  dwell 1000\n");
  // The table is the one of twin.station as far as --manual is concerned: any will do.
  write("hand.station", live_station("table.simulated = true\nimu.simulated = true\nclock.speed_up = 20\nimu.timeout_s "
                                     "= 600\nmotion.deadline_margin_s = 600\n"
                                     "motion.stall_s = 600\nresume.rest_s = 5\ntable.answer_timeout_s = 86400\n",
                                     "unit"));
  ServedUnit unit(path("unit"));
  int asked = 0, objections = 0;
  const auto turns = [&](const std::string& line) -> std::optional<std::string> {
    const bool objection = line.find("The unit senses gravity") != std::string::npos;
    const auto q = question(line);
    if (objection) {
      if (++objections == 1) unit.turn(Axis::roll, 0.0, 60.0);
      unit.turn(Axis::pitch, 89.97, 1.0);
      return "89.97";
    }
    if (!q) return {};
    ++asked;
    if (q->homing) {
      unit.turn(q->axis == "roll" ? Axis::roll : q->axis == "pitch" ? Axis::pitch : Axis::heading, 0.0, 60.0);
      return "0";
    }
    if (q->axis == "roll") return "leave";
    if (asked == 4) {
      unit.turn(Axis::roll, 90.0, 60.0);  // pitch was asked for
      return "90";
    }
    unit.turn(Axis::pitch, q->target_deg + 0.04, 1.0);
    return std::to_string(q->target_deg + 0.04);
  };
  const Session left =
      operate("run --manual --station hand.station --unit SN1 --out r --sequence short.seq --capture-only", turns);
  EXPECT_EQ(left.code, 75) << left.err << left.out;
  EXPECT_GE(objections, 1) << left.out;
  EXPECT_EQ(asked, 5);
  for (const std::string& line : lines_of(left.out + left.err)) EXPECT_TRUE(line.starts_with("[simulated]")) << line;

  int again = 0;
  const Session resumed = operate({"resume", "r"}, [&](const std::string& line) -> std::optional<std::string> {
    const auto q = question(line);
    if (!q) return {};
    ++again;
    const Axis axis = q->axis == "roll" ? Axis::roll : q->axis == "pitch" ? Axis::pitch : Axis::heading;
    unit.turn(axis, q->target_deg - 0.03, 60.0);
    return std::to_string(q->target_deg - 0.03);
  });
  EXPECT_EQ(resumed.code, 0) << resumed.err << resumed.out;
  EXPECT_EQ(again, 3 + 2) << "where it stands, back to pitch 90, on to roll -90\n" << resumed.out;
  EXPECT_SAYS(file_text(folder_ / "r/run.log"), "rests for 5 s");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "r/recording.tcr"));
}

}  // namespace
}  // namespace turncal
