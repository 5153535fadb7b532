// One list of fields a thing: whatever is written from it is read back as the same, in every form.
#include "orchestrator/station/fields.h"

#include <rapidcheck.h>

#include "orchestrator/records/journal.h"
#include "orchestrator/records/results_database.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

double any_double() {
  const std::int64_t digits = *rc::gen::inRange<std::int64_t>(-1'000'000'000, 1'000'000'000);
  return double(digits) * std::pow(10.0, *rc::gen::inRange(-12, 6));
}

std::string any_text() { return *rc::gen::container<std::string>(rc::gen::inRange(' ', '~')); }

// Draws a value for every field that its list knows of.
void draw(const Fields& fields) {
  for (const Field& field : fields) {
    const auto set = [&](const auto& value) {
      using Place = std::decay_t<decltype(value)>;
      if constexpr (std::is_same_v<Place, std::string*>)
        *value = any_text();
      else if constexpr (std::is_same_v<Place, bool*>)
        *value = *rc::gen::arbitrary<bool>();
      else if constexpr (std::is_same_v<Place, double*>)
        *value = std::abs(any_double());
      else if constexpr (std::is_same_v<Place, std::optional<double>*>)
        *value = *rc::gen::arbitrary<bool>() ? std::optional(any_double()) : std::nullopt;
      else if constexpr (std::is_same_v<Place, Choice>)
        value.set(*rc::gen::inRange<std::size_t>(0, value.words.size()));
      else if constexpr (std::is_integral_v<std::remove_pointer_t<Place>>)
        *value = static_cast<std::remove_pointer_t<Place>>(*rc::gen::inRange(0, 1'000'000'000));
      else
        *value = *rc::gen::inRange(0, 1'000'000'000);
    };
    std::visit(set, field.value);
  }
}

TEST(Fields, AnAttemptIsTheSameAsARowAndAsTexts) {
  EXPECT_TRUE(rc::check([] {
    AttemptRecord drawn, from_row, from_texts;
    draw(fields_of(drawn));
    take_row(row_of(fields_of(drawn)), fields_of(from_row));
    RC_ASSERT(texts_of(from_row) == texts_of(drawn));
    set_texts(texts_of(drawn), fields_of(from_texts));
    RC_ASSERT(texts_of(from_texts) == texts_of(drawn));
  }));
}

TEST(Fields, AJournalSaysWhatWasWritten) {
  EXPECT_TRUE(rc::check([] {
    const TemporaryFolder folder;
    const std::string path = folder / journal_name;
    CompletedDwell dwell;
    dwell.units.resize(*rc::gen::inRange<std::size_t>(1, 4));
    draw(fields_of(dwell));
    TableCommand command{0.0, Move{}};
    draw(fields_of(command));
    command.move->rate_degps += 1.0;
    command.move->acceleration_degps2 += 1.0;
    VerdictReport verdict, read;
    draw(fields_of(verdict));
    Result<JournalFile> journal = JournalFile::create(path, {{"unit", "SN1"}});
    RC_ASSERT(journal.ok() && journal->command(command).ok() && journal->dwell(dwell).ok() &&
              journal->append(JournalType::verdict, texts_of(verdict)).ok());
    const Result<JournalContents> contents = read_journal(path);
    RC_ASSERT(contents.ok() && contents->last_dwell && contents->commands.size() == 1u);
    RC_ASSERT(*contents->last_dwell == dwell);
    RC_ASSERT(texts_of(contents->commands.front()) == texts_of(command));
    set_texts(contents->verdicts.front(), fields_of(read));
    RC_ASSERT(texts_of(read) == texts_of(verdict));
  }));
}

TEST(Fields, AFileIsRefusedForWhatItLacksOrSaysWrongly) {
  double rate = 1.0;
  bool on = false;
  std::string name = "x";
  std::optional<double> height;
  const Fields fields = {{"rate", &rate, positive},
                         {"on", &on},
                         {"name", &name},
                         {"height", &height, any_number, true},
                         chosen("shape", on, {"round", "flat"}, "a shape")};
  const auto said = [&](const std::string& text) {
    Result<KeyValueFile> file = KeyValueFile::parse(text, "a.conf");
    read_fields(*file, fields);
    const Status status = file->check_all_used();
    return status ? std::string() : status.error().message;
  };
  EXPECT_EQ(said("rate = 2\non = true\nname = y\nshape = flat\n"), "");
  EXPECT_EQ(rate, 2.0);
  EXPECT_FALSE(height);
  EXPECT_SAYS(said("rate = 0\non = true\nname = y\nshape = flat\n"), "expected a number > 0");
  EXPECT_SAYS(said("rate = 1\non = yes\nname = y\nshape = flat\n"), "expected true or false");
  EXPECT_SAYS(said("rate = 1\non = true\nname =\nshape = flat\n"), "expected a text");
  EXPECT_SAYS(said("rate = 1\non = true\nname = y\nshape = oval\n"), "expected a shape");
  EXPECT_SAYS(said("on = true\nname = y\nshape = flat\n"), "'rate' is missing");
  EXPECT_SAYS(said("rate = 1\non = true\nname = y\nshape = flat\nheight = x\n"), "height");
}

}  // namespace
}  // namespace turncal
