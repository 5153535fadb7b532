#include "turntable_drivers/rig/rig_group.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <optional>

namespace turncal {

struct RigGroup::Member : public ImuSource {
  Member(RigGroup& group_in, const RigConfig& config) : group(group_in), rig(config), imu(rig) {}

  Status open() override {
    waiting.clear();
    lost_at_s.reset();
    is_open = true;
    seen = rig.samples_passed();
    return imu.open();
  }
  Result<ImuIdentity> identify() override { return imu.identify(); }
  void describe(RecordingInfo& info) const override { imu.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;
  ImuLinkCounters counters() const override { return imu.counters(); }
  void close() override {
    is_open = false;
    waiting.clear();
    imu.close();
  }

  RigGroup& group;
  Rig rig;
  RigImu imu;
  bool is_open = false;
  std::deque<ImuSample> waiting;
  std::int64_t seen = 0;            // periods whose samples were read or lost
  std::optional<double> lost_at_s;  // time of unplugging, until read() has reported it
};

Result<std::size_t> RigGroup::Member::read(std::span<ImuSample> out, double timeout_s) {
  if (group.size() == 1 || !is_open) return imu.read(out, timeout_s);
  group.bring_up(*this);
  const std::size_t ready = std::min(out.size(), waiting.size());
  std::copy_n(waiting.begin(), ready, out.begin());
  waiting.erase(waiting.begin(), waiting.begin() + std::ptrdiff_t(ready));
  const auto wanted = std::int64_t(std::floor(timeout_s / group.period_s_ + 1e-6));
  const std::int64_t waited = rig.samples_passed() - seen;
  seen = rig.samples_passed() - std::int64_t(waiting.size());
  if (ready == out.size() || (ready > 0 && (lost_at_s || rig.imu_unplugged()))) return ready;
  if (lost_at_s) {
    is_open = false;
    return device_error("simulated unit: the link was lost at " + std::to_string(*lost_at_s) + " s of rig time");
  }
  const double left_s = double(std::max<std::int64_t>(wanted - waited, 0)) * group.period_s_;
  const Result<std::size_t> got = imu.read(out.subspan(ready), left_s);
  if (!got) return got;
  seen = rig.samples_passed();
  return ready + *got;
}

RigGroup::RigGroup(const RigConfig& config, std::size_t units) : period_s_(config.sample_period_s) {
  std::vector<Rig*> rigs;
  for (std::size_t unit = 0; unit < units; ++unit) {
    members_.push_back(std::make_unique<Member>(*this, rig_of_unit(config, unit)));
    rigs.push_back(&members_.back()->rig);
  }
  table_ = std::make_unique<RigTable>(std::move(rigs), [this] { bring_up_all(); });
}
RigGroup::~RigGroup() = default;

Rig& RigGroup::rig(std::size_t unit) { return members_[unit]->rig; }
ImuSource& RigGroup::imu(std::size_t unit) { return *members_[unit]; }
double RigGroup::utc_s() const { return members_.front()->rig.config().start_utc_s + now_s(); }

std::int64_t RigGroup::samples_passed() const {
  std::int64_t furthest = 0;
  for (const auto& member : members_) furthest = std::max(furthest, member->rig.samples_passed());
  return furthest;
}

void RigGroup::bring_up(Member& member) {
  const std::int64_t now = samples_passed();
  std::array<ImuSample, 256> passing;
  while (member.rig.samples_passed() < now) {
    if (member.rig.imu_unplugged()) {
      if (member.is_open && !member.lost_at_s) member.lost_at_s = member.rig.time_s();
      member.rig.plug_imu();  // its time would stand still otherwise
    }
    const std::int64_t behind = now - member.rig.samples_passed();
    const std::size_t came = member.rig.advance_time(std::min<std::int64_t>(behind, passing.size()), passing);
    const std::size_t room = group_buffer_samples - std::min(group_buffer_samples, member.waiting.size());
    if (member.is_open && !member.lost_at_s)
      member.waiting.insert(member.waiting.end(), passing.begin(),
                            passing.begin() + std::ptrdiff_t(std::min(came, room)));
  }
}

void RigGroup::bring_up_all() {
  for (const auto& member : members_) bring_up(*member);
}

void RigGroup::pass_until(double time_s) {
  std::array<ImuSample, 256> unread;
  for (const auto& member : members_) {
    Rig& rig = member->rig;
    for (;;) {
      const auto left = std::int64_t(std::llround((time_s - rig.time_s()) / period_s_));
      if (left <= 0) break;
      // An unplugged unit stops the rig's time, so it is plugged in; its source stays closed.
      if (rig.imu_unplugged()) rig.plug_imu();
      rig.advance_time(std::min<std::int64_t>(left, unread.size()), unread);
    }
    member->waiting.clear();
    member->seen = rig.samples_passed();
  }
}

}  // namespace turncal
