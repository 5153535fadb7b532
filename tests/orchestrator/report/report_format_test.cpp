// Numbers and texts as reports print them.
#include <gtest/gtest.h>

#include <limits>

#include "orchestrator/figures/report_format.h"

namespace turncal {
namespace {

TEST(Format, Numbers) {
  EXPECT_EQ(significant(28.345, 3), "28.3");
  EXPECT_EQ(significant(0.00123456, 3), "0.00123");
  EXPECT_EQ(significant(9.996, 3), "10.0");
  EXPECT_EQ(significant(-1.234e-7, 3), "-1.23e-07");
  EXPECT_EQ(significant(-1.234e-7, 3, Alphabet::typographic), "-1.23×10⁻⁷");
  EXPECT_EQ(significant(6654.3, 3), "6654");
  EXPECT_EQ(significant(0.0), "0");
  EXPECT_EQ(significant(std::numeric_limits<double>::infinity()), "-");
  EXPECT_EQ(value_with_sigma(28.3456, 0.91), "28.35");
  EXPECT_EQ(value_with_sigma(0.932920123, 3.6e-7), "0.93292012");
  EXPECT_EQ(value_with_sigma(-0.0001, 0.91), "0.00");
  EXPECT_EQ(value_with_sigma(12345.6, 310.0), "12346");
  EXPECT_EQ(value_with_sigma(2.0, 0.0), "2.00000");
  EXPECT_EQ(quantity(28.3456, 0.91, "ug/g^2"), "28.35 ± 0.91 µg/g²");
  EXPECT_EQ(percent_change(4.0, 1.0), "-75 %");
  EXPECT_EQ(percent_change(4.0, 4.1), "+2.5 %");
  EXPECT_EQ(percent_change(4.0, 4.0), "0 %");
  EXPECT_EQ(percent_change(0.0, 4.0), "-");
  EXPECT_EQ(signed_number(-0.01, 1), "+0.0");
  EXPECT_EQ(clock_time(6342.0), "1:45:42");
}

TEST(Format, Texts) {
  EXPECT_EQ(html_escape("a<b>&\"c'\n\x7f é \xff \xc3"), "a&lt;b&gt;&amp;&quot;c&#39;   é ? ?");
  EXPECT_EQ(unit_text("deg/h/C"), "°/h/°C");
  EXPECT_EQ(unit_text("ug/g^3"), "µg/g³");
  EXPECT_EQ(unit_text("deg/h/G"), "°/h/G");
  EXPECT_EQ(unit_text("arcsec/g"), "″/g");
  EXPECT_EQ(wrap("one two three", 7), (std::vector<std::string>{"one two", "three"}));
  EXPECT_EQ(shorten("0123456789", 6), "012...");
  EXPECT_EQ(shorten("0\u00e9456789", 5), "0...") << "no half of a character";
}

}  // namespace
}  // namespace turncal
