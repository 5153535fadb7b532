// Decodes bytes into samples by a frame description. It uses no device and no clock; the caller passes the times of arrival.
//
//   decoder.space() <- bytes;  decoder.added(count, {earliest, latest});
//   while (decoder.next(sample) == FrameDecoder::Next::sample) ...
//
// Faults and what is done about them (docs/imu-frames.md, "Faults"):
// A frame with a wrong sync, length, id, check or tail is rejected, and the search resumes at its second byte.
// A number that is not finite, or pulses that are not whole or exceed 32 bits, make a frame bad.
// A status that says invalid, or a raw number outside its range, sets sample_flag_invalid.
// Frames with an implausible counter are dropped. Three in a row that count on from each other mean a reset unit: Next::restarted.
// With a weak check the first frame, and one after a gap, is accepted only once the next frame agrees with it.
// Two frames with the same counter but different contents are both returned: the receiver sees the repeated counter and decides.
// A counter that wraps within seconds cannot tell a stalled line, lost samples and a reset unit apart. Samples after a silence are
// therefore held until their arrival decides. If the line catches up, nothing was lost. If samples keep the unit's pace, or the line falls
// silent again, their delay decides: whole wraps were lost, any other delay (or a counter that begins at 0) is Next::restarted.
// If a unit sends gyros and accelerometers separately, two frames with the same counter make a sample; an unpaired one is bad.
// A cumulative field gives no sample at the start and after a gap, so a sample never spans more than one period.
// Nothing is allocated after construction.
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

// Finds frames in a byte stream: sync, id, length, check and tail must all be right. After a bad frame the search resumes at its
// second byte, so a frame that begins inside a damaged one is not lost.
//
// With an 8-bit check, or none, a frame is accepted only if the next frame's sync follows it directly. That delays it by a few
// bytes and detects dropped and inserted bytes that the check misses. (Frames with two changed bytes still pass an 8-bit check
// in 0.4 % of cases.) Frames with the same sync and an unknown id are skipped as a whole if the length field and the check tell
// their extent. Nothing is allocated after construction.

struct ScanCounters {
  std::uint64_t frames = 0;
  std::uint64_t other_frames = 0;   // valid, but with an id that no variant has
  std::uint64_t bad_frames = 0;     // no valid frame where one should have begun
  std::uint64_t resyncs = 0;        // frames found again after a bad one
  std::uint64_t skipped_bytes = 0;  // not part of any frame
};

struct ScannedFrame {
  const std::byte* data = nullptr;  // valid until the next call of the scanner
  std::size_t variant = 0;
  std::uint64_t skipped_before = 0;  // bytes skipped since the frame before
};

class FrameScanner {
 public:
  explicit FrameScanner(const FrameDescription& frame);

  // The space for new bytes, and how many were put there. It is never empty after next() has returned false.
  std::span<std::byte> space();
  void added(std::size_t count);
  // Returns false when it needs more bytes.
  bool next(ScannedFrame& frame);
  // Discards all buffered bytes; a new stream begins.
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
  std::size_t lead_;  // bytes between end_ and space(): room for a byte that the unstuffer held back

  std::vector<std::byte> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  bool in_step_ = false;        // a frame ended right before begin_
  bool seeking_again_ = false;  // a frame was expected and was bad; counts as a resync once found
  std::uint64_t skipped_ = 0;
  ScanCounters counters_;
};

// ---- the decoder ----

// The raw values of the cumulative fields in the frame before.
struct CumulativeBase {
  std::array<std::uint64_t, 12> field{};  // the fields, then the `down` fields
  bool known = false;
};

class FrameDecoder {
 public:
  explicit FrameDecoder(const FrameDescription& frame);

  std::span<std::byte> space() { return scanner_.space(); }
  void added(std::size_t count, const Arrival& arrival);
  enum class Next { sample, more, restarted };
  Next next(ImuSample& sample);
  // Says that the line is empty at that time, so that held samples may be decided.
  void idle(double now_s);
  // The reason for Next::restarted.
  const std::string& restart_reason() const { return restart_reason_; }
  // To call after the link was down: buffered bytes are discarded, and the counter continues where it can.
  void rejoin();

  ImuLinkCounters counters() const;
  std::uint64_t strays() const { return strays_; }    // frames with an implausible counter
  std::uint64_t invalid() const { return invalid_; }  // samples flagged
  const ScanCounters& scan() const { return scanner_.counters(); }
  // The arrival of the last sample's frame.
  const Arrival& arrival() const { return arrival_; }
  double wrap_s() const { return state_.tracker.wrap_s(); }

 private:
  static constexpr std::size_t most_held = 32768;  // samples
  // A counter with a longer wrap is unambiguous after every silence that a run survives.
  static constexpr double narrow_wrap_s = 30.0;

  // Samples held after a silence until it is known how many were lost.
  struct Hold {
    bool active = false;
    std::int64_t from_counter = 0;  // the last sample before the silence, and its arrival below
    double from_s = 0.0;
    std::int64_t jump = 0;   // first counter after the last jump; all losses are before it
    bool from_zero = false;  // the counter began at 0, and 0 was not the next value
    double last_s = 0.0;     // arrival of the last frame
    double window_end_s = 0.0, window_late_s = 0.0, before_late_s = 0.0;
  };
  // The state that is restored when a frame turns out not to be valid.
  struct State {
    CounterTracker tracker;
    CumulativeBase base{};
    float temperature_c = std::numeric_limits<float>::quiet_NaN();
    std::uint64_t lost = 0;
    Hold hold{};
    ImuSample last{};  // the last accepted sample
    bool has_last = false;
  };
  // Joins the two frames of a sample; false while the other one is missing.
  bool join(const ScannedFrame& scanned, ScannedFrame& whole);
  void decode(const ScannedFrame& scanned);
  void handle_stray(double raw);
  void believe(const PlacedCounter& placed, double raw, const FrameVariant& variant, const std::byte* frame,
               ImuSample& sample);
  void emit(const ImuSample& sample);
  // Handling of a silence:
  bool is_unsure(const PlacedCounter& placed) const;
  void begin_hold(const PlacedCounter& placed, double raw);
  void judge_hold();
  void decide(double late_s);  // late_s: the delay of the last held samples, assuming no loss
  double held_late_s() const;
  std::int64_t wraps_in(double late_s) const;
  bool is_whole_wraps(double late_s) const;
  void release(std::int64_t wraps);
  void restart(const std::string& reason);

  FrameScanner scanner_;
  std::vector<FrameVariant> variants_;  // split: gyros, accelerometers, then both frames joined
  bool split_;
  std::vector<std::byte> joined_;
  std::array<std::optional<double>, 2> part_counter_;  // counters of the frames that wait for their other half
  bool any_cumulative_ = false;
  bool weak_;
  double step_, modulus_;
  State state_;
  State before_;          // valid while waiting_
  bool waiting_ = false;  // the last frame needs confirmation by the next
  bool waiting_has_sample_ = false;
  ImuSample waiting_sample_;
  Arrival arrival_;
  double period_s_;
  std::vector<ImuSample> ready_;                  // never reallocated
  std::size_t ready_given_ = 0, ready_free_ = 0;  // samples from ready_free_ on are held
  double stray_raw_ = 0.0;
  int strays_in_row_ = 0;
  bool restarted_ = false;
  std::string restart_reason_;
  std::uint64_t samples_ = 0, duplicates_ = 0, unusable_ = 0, strays_ = 0, invalid_ = 0;
};

// Reads a file of a unit's raw bytes, written by any terminal program or logger, as the samples of a recording.
//
// A log has no times of arrival, so losses are known from the counter alone. A jump of up to ten minutes is a gap; the wraps of a narrow
// counter within it are unknown. A larger or backward jump means a reset unit, whose biases may have changed: an error.
struct FrameLog {
  std::vector<ImuSample> samples;
  std::string summary;  // "12000 frames, 0 bad, 3 samples lost, ..."
};

// An error when the file has no frame of that description.
Result<FrameLog> read_frame_log(const std::string& path, const FrameDescription& frame);

}  // namespace turncal
