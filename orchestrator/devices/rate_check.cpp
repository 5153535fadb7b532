#include "orchestrator/devices/rate_check.h"

#include <cmath>
#include <cstdio>

namespace turncal {

namespace {

double known(double rate_degps) { return std::isfinite(rate_degps) ? rate_degps : 0.0; }

}  // namespace

void RateCheck::add(const AxisStatus& now) {
  summed_deg_ += 0.5 * (known(now.rate_degps) + known(last_.rate_degps)) * (now.time_s - last_.time_s);
  polls_ += now.position_deg != last_.position_deg ? 1 : 0;
  said_moving_ = said_moving_ || now.moving;
  last_ = now;
}

Status RateCheck::judge(Axis axis, double tolerance) const {
  const double turned_deg = last_.position_deg - began_deg_;
  const bool rate_fits = std::abs(summed_deg_ - turned_deg) <= tolerance * std::abs(turned_deg);
  if (polls_ < fewest_polls || (rate_fits && said_moving_)) return {};
  char text[240];
  if (rate_fits) {
    std::snprintf(text, sizeof text, "%s turned by %+.3f deg and never said so: expected a bit or code of moving",
                  to_string(axis), turned_deg);
  } else {
    std::snprintf(text, sizeof text,
                  "%s turned by %+.3f deg while its rate summed up to %+.3f deg: expected a rate that says how fast it "
                  "turns (its register or field, scale and sign)",
                  to_string(axis), turned_deg, summed_deg_);
  }
  return input_error(text);
}

}  // namespace turncal
