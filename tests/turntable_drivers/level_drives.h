// Three drives of a kind that the twin is not: a control word whose lowest bit is the enable, as a level, so that a braking stop which
// holds it switches a drive on. Written against the Modbus frames alone; turns at the commanded rate in real time.
//
//   0x00 control: bit 0 enable, bit 1 brake, bit 2 go (an edge), bit 3 home
//   0x10 s32 position, 0x12 s32 rate (counts/s), 0x14 status: bit 0 on, 1 in position, 2 fault, 3 moving, 4 homed
//   0x20 s32 target, u32 rate
#pragma once

#include "imu_io/base/clock.h"
#include "tests/turntable_drivers/served_twin.h"
#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/twins/line_server.h"

namespace turncal {

struct LevelDrive {
  std::uint16_t control = 0;
  bool homed = false;
  double position = 0.0, target = 0.0, rate = 0.0, commanded_rate = 0.0, at_s = monotonic_s();
  double told = 0.0, told_s = -1e9;  // the position that is read, and since when
  double creep = 0.0;                // counts/s that its status and its rate do not tell, whatever it is told
  std::vector<std::uint16_t> words;  // every control word that came

  void pass() {
    const double now_s = monotonic_s();
    const double left = target - position, step = std::abs(rate) * (now_s - at_s);
    position += creep * (now_s - at_s);
    at_s = now_s;
    if ((control & 1) == 0 || (control & 2) != 0) rate = 0.0;
    if (rate == 0.0) return;
    position = step >= std::abs(left) ? target : position + std::copysign(step, left);
    if (position == target) rate = 0.0;
  }
  void write_control(std::uint16_t word) {
    pass();
    if ((word & 5) == 5 && (control & 4) == 0) rate = std::copysign(commanded_rate, target - position);
    if ((word & 9) == 9) homed = true;
    control = word;
    words.push_back(word);
    pass();
  }
};

class LevelDrives : public LineServer {
 public:
  LevelDrives() {
    EXPECT_OK(listen_tcp(0));
    serving_.emplace(*this);
  }
  std::string map_text(const std::string& more = "") const {
    return own_map_text("level", "tcp\nlink.address = " + address()) + more;
  }
  RegisterMap map(const std::string& more = "") const { return map_of(map_text(more)); }
  // Copies, for the server's thread goes on.
  LevelDrive drive(int unit) {
    const std::lock_guard lock(mutex);
    drives[unit].pass();
    return drives[unit];
  }
  bool all_off() { return (drive(1).control & 1) == 0 && (drive(2).control & 1) == 0 && (drive(3).control & 1) == 0; }
  std::size_t words() { return drive(1).words.size() + drive(2).words.size() + drive(3).words.size(); }

  std::atomic<bool> reads_answered{true};
  std::atomic<bool> rate_reads_zero{false};    // nor does the status say that it moves
  std::atomic<bool> moving_never_said{false};  // but the rate is told
  std::atomic<bool> on_reads_zero{false};      // whatever the drive is
  std::atomic<bool> words_swapped{false};      // of what is read
  std::atomic<int> exception{0};               // in place of a reading
  std::atomic<double> read_anew_s{0.0};        // so old may a position be
  std::atomic<double> answer_s{0.0};           // a reading takes so long
  std::atomic<int> refuses_off{0};  // so many words that would switch a drive off are answered and do nothing
  std::map<int, LevelDrive> drives{{1, {}}, {2, {}}, {3, {}}};

 private:
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override {
    const std::optional<ModbusRequest> request = next_request(bytes, true);
    if (!request) return {};
    const std::lock_guard lock(mutex);
    LevelDrive& drive = drives[request->unit];
    drive.pass();
    AnswerPlan plan;
    if (request->function == 3) {
      if (!reads_answered) return plan;
      if (drive.at_s - drive.told_s >= read_anew_s) {
        drive.told_s = drive.at_s;
        drive.told = drive.position;
      }
      const auto position = std::uint32_t(std::int32_t(drive.told));
      const auto rate = std::uint32_t(std::int32_t(rate_reads_zero ? 0.0 : drive.rate));
      const bool on = (drive.control & 1) != 0 && !on_reads_zero,
                 moves = drive.rate != 0.0 && !rate_reads_zero && !moving_never_said;
      const std::uint16_t status = std::uint16_t((on ? 1 : 0) | (moves ? 8 : 2) | (drive.homed ? 16 : 0));
      std::vector<std::uint16_t> block = {std::uint16_t(position >> 16), std::uint16_t(position),
                                          std::uint16_t(rate >> 16), std::uint16_t(rate), status};
      if (words_swapped) std::swap(block[0], block[1]);
      block.resize(std::size_t(request->count));
      plan.pieces.push_back(
          {exception != 0 ? exception_reply(*request, exception, true) : read_reply(*request, block, true), answer_s});
      return plan;
    }
    if (request->address == 0) {
      const bool ignored = (request->values[0] & 1) == 0 && refuses_off > 0;
      if (ignored) {
        --refuses_off;
      } else {
        drive.write_control(request->values[0]);
      }
    } else if (request->address == 0x20) {
      drive.target = std::int32_t(std::uint32_t(request->values[0]) << 16 | request->values[1]);
      drive.commanded_rate = double(std::uint32_t(request->values[2]) << 16 | request->values[3]);
    }
    plan.pieces.push_back({write_reply(*request, true), 0.0});
    return plan;
  }

  std::optional<Serving> serving_;
};

}  // namespace turncal
