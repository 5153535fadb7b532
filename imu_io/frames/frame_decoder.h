// Bytes in, samples out, by a frame description. Pure: no device, no clock; the caller says when bytes arrived.
//
//   decoder.space() <- bytes;  decoder.added(count, {earliest, latest});
//   while (decoder.next(sample) == FrameDecoder::Next::sample) ...
//
// What is done about each defect (docs/imu-frames.md, "Faults"): a frame with a wrong sync, length, id, check or tail is not used,
// and the search goes on at its second byte. A number that is not finite, or pulses that are not whole or beyond 32 bits, make a
// frame bad. A status that says invalid, or a raw number outside its range, sets sample_flag_invalid. Frames of a counter that
// cannot be true are dropped; three in a row that agree with each other mean that the unit began anew: Next::restarted.
// With a weak check the first frame, and one after a gap, wait for a following one that agrees with them.
// Two frames of one counter that say different things are both given: the receiver sees the counter twice and judges.
// A counter that wraps within seconds cannot tell a line that stalled from samples that were lost, nor a unit that was reset: after a
// silence its samples are held until their arrival tells. A line that stalled catches up: nothing was lost. Samples that come at
// the unit's pace, or a line that falls silent again, show by how much: if that is whole wraps, those were lost, else (or when the
// counter begins at 0) it is Next::restarted.
// Of a unit that sends gyros and accelerometers apart two frames of one counter are a sample; one that stays alone is a bad frame.
// A cumulative field gives no sample at the beginning and after a gap: one row never holds more than one period.
// No allocation after construction.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "imu_io/frames/counter_tracker.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_field.h"
#include "imu_io/recordings/imu_source.h"

namespace turncal {

// Finds frames in a byte stream: sync, id, length, check and tail must all be right. After a frame that is not, the search goes
// on at its second byte, never after the whole of it: a frame that begins inside a damaged one is not lost.
//
// With a check of 8 bits or none a frame counts only when the next one's sync comes right after it. That costs the time
// of a few bytes and takes away what the check cannot see of dropped and inserted bytes. (What it cannot see of changed
// bytes, 0.4 % of the frames with two of them, remains.) Other frames of the same sync (an id of no variant) are passed
// over whole when the length field and the check tell how far they reach. No allocation after construction.

struct ScanCounters {
  std::uint64_t frames = 0;
  std::uint64_t other_frames = 0;   // good, of an id that holds no samples
  std::uint64_t bad_frames = 0;     // where a frame should have begun and none did
  std::uint64_t resyncs = 0;        // found again after that
  std::uint64_t skipped_bytes = 0;  // not part of any frame
};

struct ScannedFrame {
  const std::byte* data = nullptr;  // until the next call of the scanner
  std::size_t variant = 0;
  std::uint64_t skipped_before = 0;  // bytes thrown away since the frame before
};

class FrameScanner {
 public:
  explicit FrameScanner(const FrameDescription& frame);

  // Where new bytes are to be put, and how many of them were. Space is empty only before next() has returned false.
  std::span<std::byte> space();
  void added(std::size_t count);
  // False: more bytes are needed.
  bool next(ScannedFrame& frame);
  // Forgets what it holds; the stream begins anew.
  void restart();
  const ScanCounters& counters() const { return counters_; }

 private:
  enum class Verdict { good, other, bad, more };
  Verdict judge(std::span<const std::byte> remaining, std::size_t& length, std::size_t& variant) const;
  bool sync_at(std::span<const std::byte> remaining) const;
  bool check_good(std::span<const std::byte> frame) const;

  FrameDescription frame_;
  Crc crc_;
  Unstuffer unstuffer_;
  std::size_t lead_;  // bytes between end_ and space(): what was held back comes first

  std::vector<std::byte> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  bool in_step_ = false;        // a frame ended right before begin_
  bool seeking_again_ = false;  // a frame was expected and was bad
  std::uint64_t skipped_ = 0;
  ScanCounters counters_;
};

// ---- the decoder ----

// What the cumulative fields read in the frame before.
struct CumulativeBase {
  std::array<std::uint64_t, 12> field{};  // the fields, then what counts the other way
  bool known = false;
};

class FrameDecoder {
 public:
  explicit FrameDecoder(const FrameDescription& frame);

  std::span<std::byte> space() { return scanner_.space(); }
  void added(std::size_t count, const Arrival& arrival);
  enum class Next { sample, more, restarted };
  Next next(ImuSample& sample);
  // The line is empty at that time: what is held may be decided.
  void idle(double now_s);
  // Why, after Next::restarted.
  const std::string& restart_reason() const { return restart_reason_; }
  // The link was down: the bytes held are thrown away, the counter goes on where it can.
  void rejoin();

  ImuLinkCounters counters() const;
  std::uint64_t strays() const { return strays_; }    // frames of an impossible counter
  std::uint64_t invalid() const { return invalid_; }  // samples flagged
  const ScanCounters& scan() const { return scanner_.counters(); }
  // When the last sample's frame arrived.
  const Arrival& arrival() const { return arrival_; }
  double wrap_s() const { return state_.tracker.wrap_s(); }

 private:
  static constexpr std::size_t most_held = 32768;  // samples
  // A counter that wraps later than this tells every silence a run survives.
  static constexpr double narrow_wrap_s = 30.0;

  // Samples after a silence of which it is not known yet how many were lost in it.
  struct Hold {
    bool active = false;
    std::int64_t from_counter = 0;  // the last sample before it, and when that came
    double from_s = 0.0;
    std::int64_t jump = 0;   // first counter after the last jump: what was lost was lost before it
    bool from_zero = false;  // the counter began at 0, and not because that was next
    double last_s = 0.0;     // when the last frame came
    double window_end_s = 0.0, window_late_s = 0.0, before_late_s = 0.0;
  };
  // What a frame that turns out not to be believed must not have changed.
  struct State {
    CounterTracker tracker;
    CumulativeBase base{};
    float temperature_c = std::numeric_limits<float>::quiet_NaN();
    std::uint64_t lost = 0;
    Hold hold{};
    ImuSample last{};  // as believed
    bool has_last = false;
  };
  // The two frames of a sample put together; false: the other one is still to come.
  bool join(const ScannedFrame& scanned, ScannedFrame& whole);
  void decode(const ScannedFrame& scanned);
  void handle_stray(double raw);
  void believe(const PlacedCounter& placed, double raw, const FrameVariant& variant, const std::byte* frame,
               ImuSample& sample);
  void emit(const ImuSample& sample);
  // After a silence.
  bool is_unsure(const PlacedCounter& placed) const;
  void begin_hold(const PlacedCounter& placed, double raw);
  void judge_hold();
  void decide(double late_s);  // by how much the last held samples are late if nothing was lost
  double held_late_s() const;
  std::int64_t wraps_in(double late_s) const;
  bool is_whole_wraps(double late_s) const;
  void release(std::int64_t wraps);
  void restart(const std::string& reason);

  FrameScanner scanner_;
  std::vector<FrameVariant> variants_;  // split: gyros, accelerometers, and the two frames one after the other
  bool split_;
  std::vector<std::byte> joined_;
  std::array<std::optional<double>, 2> part_counter_;  // of the frames that wait for the other one
  bool any_cumulative_ = false;
  bool weak_;
  double step_, modulus_;
  State state_;
  State before_;          // while waiting_
  bool waiting_ = false;  // the last frame has to be confirmed
  bool waiting_has_sample_ = false;
  ImuSample waiting_sample_;
  Arrival arrival_;
  double period_s_;
  std::vector<ImuSample> ready_;                  // never grown
  std::size_t ready_given_ = 0, ready_free_ = 0;  // from there on they are held
  double stray_raw_ = 0.0;
  int strays_in_row_ = 0;
  bool restarted_ = false;
  std::string restart_reason_;
  std::uint64_t samples_ = 0, duplicates_ = 0, unusable_ = 0, strays_ = 0, invalid_ = 0;
};

// A file of a unit's raw bytes, as some terminal or logger wrote them, as the samples of a recording.
//
// A log has no times of arrival. So the counter alone says what was lost: a jump of up to ten minutes is a gap, and how often a narrow counter
// wrapped within one cannot be told. A larger jump, or one back, is a unit that began anew: an error, since its biases may be others.
struct FrameLog {
  std::vector<ImuSample> samples;
  std::string summary;  // "12000 frames, 0 bad, 3 samples lost, ..."
};

// Error: no frame of that description in it.
Result<FrameLog> read_frame_log(const std::string& path, const FrameDescription& frame);

}  // namespace turncal
