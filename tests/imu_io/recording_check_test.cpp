// What may stand in a serial number.
#include "imu_io/recordings/recording_check.h"

#include <gtest/gtest.h>

#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

TEST(RecordingCheck, PlainTextIsPrintableUtf8) {
  for (const char* good :
       {"RLG-0042", "\xC3\xA4\xC3\xB6", "\xE5\x8D\x95\xE5\x85\x83 7", "\xF0\x9F\x9B\xB0", "a=b", "\xC2\xA0x"})
    EXPECT_TRUE(is_plain_text(good)) << good;
  for (const char* bad : {"",
                          " a",
                          "a ",
                          "a#b",
                          "a\tb",
                          "a\nb",
                          "a\x7F"
                          "b",
                          "\xC2\x80",
                          "a\xC2\x9B"
                          "31m",
                          "a\xC2\x9F",  // C1: U+009B begins an escape sequence
                          "\xFF",
                          "\x80",
                          "a\x9B"
                          "b",
                          "\xC3",
                          "\xE5\x8D",
                          "\xF0\x9F\x9B",  // no UTF-8, cut short
                          "\xC0\xAF",
                          "\xC1\xBF",
                          "\xE0\x80\xAF",
                          "\xF0\x80\x80\xAF",  // longer than need be
                          "\xED\xA0\x80",
                          "\xF4\x90\x80\x80",
                          "\xF5\x80\x80\x80",  // surrogate, beyond the last
                          "a\xE2\x80\xAE"
                          "b",
                          "a\xE2\x80\xA8"
                          "b",
                          "\xE2\x81\xA6",  // turns the writing, ends the line
                          "\xE2\x80\x8B",
                          "\xEF\xBB\xBFSN1",
                          "SN\xC2\xAD"
                          "1"})  // is not seen
    EXPECT_FALSE(is_plain_text(bad)) << quoted(bad);
}

TEST(RecordingCheck, WhatIsQuotedCanBePrinted) {
  EXPECT_EQ(quoted("a\xC2\x9B"
                   "31m\xFF\n\xC3\xA4"),
            "'a??31m??\xC3\xA4'");
}

}  // namespace
}  // namespace turncal
