#include "imu_io/base/atomic_file.h"

#include "tests/test.h"

namespace turncal {
namespace {

TEST(AtomicFile, NothingIsVisibleBeforeCommit) {
  TemporaryFolder folder;
  const std::string path = folder / "a.csv";
  auto file = good(AtomicFile::create(path));
  ASSERT_OK(file->write(std::string(3 << 20, 'x')));  // more than is buffered
  EXPECT_FALSE(path_exists(path));
  ASSERT_OK(file->commit());
  EXPECT_EQ(file_text(path).size(), std::size_t{3} << 20);
}

TEST(AtomicFile, WithoutCommitTheOldFileStaysAndTheTemporaryGoes) {
  TemporaryFolder folder;
  const std::string path = folder / "a.csv";
  write_file(path, "old");
  {
    auto file = good(AtomicFile::create(path));
    ASSERT_OK(file->write("half"));
    EXPECT_EQ(folder.names().size(), 2U);
  }
  EXPECT_EQ(file_text(path), "old");
  EXPECT_EQ(folder.names().size(), 1U);
}

TEST(AtomicFile, FullDiskKeepsTheOldFileAndIsADeviceError) {
  TemporaryFolder folder;
  const std::string path = folder / "a.csv";
  write_file(path, "old");
  {
    const FileSizeLimit limit(1000);
    ASSERT_TRUE(
        fails(write_file_atomically(path, std::string(5000, 'x')), ErrorKind::device, "cannot write: File too large"));
  }
  EXPECT_EQ(file_text(path), "old");
  EXPECT_EQ(folder.names().size(), 1U);
}

TEST(AtomicFile, CommitAfterAFailedWriteFails) {
  TemporaryFolder folder;
  auto file = good(AtomicFile::create(folder / "a.csv"));
  {
    const FileSizeLimit limit(1000);
    EXPECT_FALSE(file->write(std::string(3 << 20, 'x')).ok());
  }
  EXPECT_ERROR(file->commit(), (folder / "a.csv") + ": not written, an earlier write failed");
  EXPECT_FALSE(path_exists(folder / "a.csv"));
}

TEST(AtomicFile, MissingFolderAndFolderInTheWay) {
  TemporaryFolder folder;
  ASSERT_TRUE(fails(write_file_atomically(folder / "no/a.conf", "x"), ErrorKind::input));
  ASSERT_OK(make_folder(folder / "taken/inside"));
  ASSERT_FALSE(write_file_atomically(folder / "taken", "x").ok());
  EXPECT_EQ(folder.names(), (std::vector<std::string>{"taken"}));
}

TEST(AtomicFile, TemporaryOfADeadProcessIsNoObstacle) {
  TemporaryFolder folder;
  for (int i = 0; i < 3; ++i) write_file(temporary_name(folder / "a"), "left behind");
  ASSERT_OK(write_file_atomically(folder / "a", "new"));
  EXPECT_EQ(file_text(folder / "a"), "new");
}

TEST(PosixFile, WholeFileAboveTheLimitIsRefused) {
  TemporaryFolder folder;
  write_file(folder / "a", "12345");
  EXPECT_ERROR(read_whole_file(folder / "a", 4), (folder / "a") + ": 5 bytes: expected at most 4");
  EXPECT_EQ(*read_whole_file(folder / "a", 5), "12345");
}

TEST(AtomicFile, ADeviceOrAPipeIsNotReplaced) {
  TemporaryFolder folder;
  ASSERT_EQ(::mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_ERROR(write_file_atomically(folder / "pipe", "x"), (folder / "pipe") + ": not a regular file");
  struct stat after {};
  ASSERT_EQ(::stat((folder / "pipe").c_str(), &after), 0);
  EXPECT_TRUE(S_ISFIFO(after.st_mode));
}

TEST(PosixFile, PipeInPlaceOfAFileDoesNotHang) {
  TemporaryFolder folder;
  ASSERT_EQ(::mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_ERROR(read_whole_file(folder / "pipe"), (folder / "pipe") + ": not a regular file");
}

}  // namespace
}  // namespace turncal
