// For tests of the ASCII driver: the shipped dialects, and those of our own invention (own_...), made ready for a twin.
#pragma once

#include <string>

#include <gtest/gtest.h>

#include "tests/turntable_drivers/served_twin.h"
#include "turntable_drivers/ascii/serial_turntable.h"

namespace turncal {

inline Dialect shipped_dialect(const std::string& name, bool tcp = false) {
  const std::string folder =
      name.starts_with("own_") ? "/tests/turntable_drivers/dialects/" : "/turntable_drivers/ascii/dialects/";
  const Result<Dialect> read = read_dialect(TURNCAL_SOURCE_DIR + folder + name + ".dialect");
  EXPECT_TRUE(read.ok()) << (read.ok() ? "" : read.error().message);
  if (!read) return {};
  Dialect dialect = *read;
  EXPECT_FALSE(dialect.verified_on_hardware);
  EXPECT_FALSE(dialect.commissioned);
  dialect.commissioned = true;
  dialect.link.tcp = tcp;
  dialect.link.quiet_s = 0.1;
  return dialect;
}

}  // namespace turncal
