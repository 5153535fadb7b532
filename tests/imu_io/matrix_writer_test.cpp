// Columns as .npy, .mat and CSV: read again by the reader of such files, and replaced only by their like.
#include "imu_io/recordings/matrix_writer.h"

#include <gtest/gtest.h>

#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/number_table.h"
#include "tests/imu_io/temporary_folder.h"

namespace turncal {
namespace {

const std::vector<NumberColumn> sample_columns = {{"time_s", {0.0, 0.1, 1e300}}, {"x.y", {-1.0, 1.0 / 3.0, 7.0}}};

TEST(MatrixWriter, IsReadAgain) {
  test::TemporaryFolder folder;
  for (const char* name : {"a.npy", "a.mat", "a.csv"}) {
    const std::string path = folder / name;
    const Status written = write_columns(path, sample_columns);
    ASSERT_TRUE(written.ok()) << written.error().message;
    const std::string text = test::read_file(path);
    const std::string form = path.substr(path.size() - 3);
    const std::vector<WantedColumn> wanted = form == "npy"   ? std::vector<WantedColumn>{{"1"}, {"2"}}
                                             : form == "mat" ? std::vector<WantedColumn>{{"time_s"}, {"x_y"}}
                                                             : std::vector<WantedColumn>{{"time_s"}, {"x.y"}};
    const auto table = read_number_table(text, path, wanted, {});
    ASSERT_TRUE(table.ok()) << table.error().message;
    for (std::size_t k = 0; k < 2; ++k) EXPECT_EQ(table->columns[k], sample_columns[k].values) << name;
    // Again: the same bytes; nothing beside it.
    ASSERT_TRUE(write_columns(path, sample_columns).ok());
    EXPECT_EQ(test::read_file(path), text);
  }
  // The data of a .npy begin on a multiple of 64 bytes.
  const std::string npy = test::read_file(folder / "a.npy");
  EXPECT_EQ((npy.size() - 6 * 8) % 64, 0u);
  EXPECT_EQ(folder.names().size(), 3u);
}

TEST(MatrixWriter, ReplacesOnlyItsLike) {
  test::TemporaryFolder folder;
  for (const char* name : {"a.npy", "a.mat", "a.csv"}) {
    test::write_file(folder / name, "precious");
    const Status refused = write_columns(folder / name, sample_columns);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().kind, ErrorKind::input);
    EXPECT_EQ(test::read_file(folder / name), "precious");
    EXPECT_FALSE(write_columns(folder / ("nowhere/" + std::string(name)), sample_columns).ok());
  }
}

}  // namespace
}  // namespace turncal
