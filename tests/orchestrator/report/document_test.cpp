// A document and its renderings.
#include "orchestrator/station/number_text.h"
#include "orchestrator/watch/progress.h"
#include "tests/orchestrator/report/sample_diagnosis.h"
#include "tests/test.h"

namespace turncal {
namespace {

// --- Numbers and texts.

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
  EXPECT_EQ(value_with_sigma(12345.6, 310.0), "12350");
  EXPECT_EQ(plus_minus(-12958.6060944532, 55.0), "-12959 +- 55");
  EXPECT_EQ(plus_minus(-12958.6, 5500.0, Alphabet::typographic), "-13000 ± 5500");
  EXPECT_EQ(value_with_sigma(2.0, 0.0), "2.00000");
  EXPECT_EQ(quantity(28.3456, 0.91, "ug/g^2"), "28.35 ± 0.91 µg/g²");
  for (const auto& [after, words] : {std::pair{1.0, "-75 %"}, {4.1, "+2.5 %"}, {4.0, "0 %"}})
    EXPECT_EQ(percent_change(4.0, after), words);
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
  EXPECT_EQ(shorten("0\u00e9456789", 5), "0\u00e9...") << "columns, not bytes";
  EXPECT_EQ(columns_of("SN0401\u6d4b\u8bd5"), 10u) << "a character of Chinese has two";
}

TEST(Document, IsPlainOnTheTerminal) {
  for (const auto& [typographic, expected] :
       std::vector<std::pair<const char*, const char*>>{{"28.35 ± 0.91 µg/g²", "28.35 +- 0.91 ug/g^2"},
                                                        {"0.002 °/√h, 8 µg/√Hz", "0.002 deg/sqrt(h), 8 ug/sqrt(Hz)"},
                                                        {"1.23×10⁻⁷ °/h/°C", "1.23e-07 deg/h/C"},
                                                        {"5×10¹² ″", "5e+12 arcsec"},
                                                        {"χ² of σ − τ, “Ä”", "chi^2 of sigma - tau, \"Ä\""}})
    EXPECT_EQ(plain(typographic), expected);
  // Whatever a number is, both alphabets say the same one.
  for (double value = 1.7e-12; value < 1e13; value *= 7.0)
    EXPECT_EQ(plain(significant(value, 3, Alphabet::typographic)), significant(value));
}

// One document with a block of every kind and every scope.
Document sample_document() {
  Document document{"Window", "Heading <1>"};
  document.text("First: 50 % of it.");
  document.add(Paragraph{"Good: all is well", "verdict clean"}, Scope::page);
  document.section("part", "A part");
  document.add(Facts{{{"noise", std::string(120, 'n') + " " + std::string(60, 'm')}, {"", "more"}}}, Scope::terminal);
  document.add(Facts{{{"Norm.", "of gravity"}}, true}, Scope::page);
  Table table{{cell::name("unit"), cell::number("value, µg"), cell::number("z"), cell::half(0.0), cell::wide("why")}};
  table.most = 2;
  table.row({cell::name("SN<1>"), cell::with_sigma(20.25, 0.7512), cell::number("-"), cell::half(-0.5),
             cell::wide("because")},
            Table::Emphasis::hit);
  table.row({cell::name("SN\"2\""), cell::number(-1.5e-7), cell::number("1 of 3", 1.0), cell::half(1.0),
             cell::wide(std::string(150, 'w'))});
  table.row({cell::name("SN3"), cell::below(3.0, 1), cell::number("given"), cell::half(0.0), cell::wide("")},
            Table::Emphasis::dim);
  document.add(table);
  return document;
}

TEST(Document, OnTheTerminalHasColumnsThatFit) {
  EXPECT_EQ(as_text(sample_document()), "First: 50 % of it.\n\nA part\nnoise           " + std::string(84, 'n') +
                                            "\n                " + std::string(36, 'n') + "\n                " +
                                            std::string(60, 'm') +
                                            "\n                more\n"
                                            "unit   value, ug       z  why\n"
                                            "SN<1>      20.25       -  because\n"
                                            "SN\"2\"  -1.50e-07  1 of 3  " +
                                            std::string(150, 'w') + "\nand 1 more in the report\n");
  EXPECT_EQ(as_text(sample_document(), 3), "First: 50 % of it.\n\n... more in the report\n");
}

TEST(Document, OnAPageIsEscapedAndMarked) {
  const std::string html = as_page(sample_document()).html;
  for (const char* part :
       {"<title>Window</title>", "<h1>Heading &lt;1&gt;</h1>", "<p>First: 50&nbsp;% of it.</p>",
        "<div class=\"verdict clean\"><p><b>Good:</b> all is well</p></div>", "<h2 id=\"part\">A part</h2>",
        "<li><b>Norm.</b> of gravity</li>", "<th class=\"n\">value, µg</th>",
        "<tr class=\"hit\"><td class=\"name\">SN&lt;1&gt;</td>", "<td class=\"n\">-1.50×10⁻⁷</td>",
        "<td class=\"half\"><span class=\"bar\" style=\"margin-left:38px;width:38px\"></span></td>",
        "<tr class=\"dim\"><td class=\"name\">SN3</td>",
        // Phones and paper.
        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">", ".wide { overflow-x:auto;",
        "@media screen and (max-width:700px)", "figure, table, tr, .verdict { break-inside:avoid; }"})
    EXPECT_SAYS(html, part);
  EXPECT_SAYS_NOT(html, "nnnn");
}

TEST(Document, AsJsonHasTypesAndAllDigits) {
  EXPECT_EQ(as_json(sample_document()),
            "{\"title\":\"Heading \\u003c1>\",\"text\":[\"First: 50 % of it.\",\"Good: all is well\"],\"sections\":[\n"
            "{\"id\":\"part\",\"title\":\"A part\",\"facts\":{\"Norm.\":\"of gravity\"},\"tables\":[[\n"
            "{\"unit\":\"SN\\u003c1>\",\"value, ug\":20.25,\"z\":null,\"why\":\"because\"},\n"
            "{\"unit\":\"SN\\\"2\\\"\",\"value, ug\":-1.5e-07,\"z\":1,\"why\":\"" +
                std::string(150, 'w') +
                "\"},\n"
                "{\"unit\":\"SN3\",\"value, ug\":null,\"value, ug, at most\":3,\"z\":\"given\",\"why\":\"\"}]]}]}\n");
}

}  // namespace
}  // namespace turncal
