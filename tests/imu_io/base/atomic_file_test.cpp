#include "imu_io/base/files.h"

#include "imu_io/base/file_kind.h"
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
    auto file = good(AtomicFile::create(path));
    EXPECT_FALSE(file->write(std::string(3 << 20, 'x')).ok());
    EXPECT_ERROR(file->commit(), path + ": not written, an earlier write failed");
  }
  EXPECT_EQ(file_text(path), "old");
  EXPECT_EQ(folder.names().size(), 1U);
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

TEST(AtomicFile, ADeviceOrAPipeIsNotReplacedAndDoesNotHang) {
  TemporaryFolder folder;
  const std::string pipe = folder / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_ERROR(write_file_atomically(pipe, "x"), pipe + ": not a regular file");
  EXPECT_TRUE(std::filesystem::is_fifo(pipe));
  EXPECT_ERROR(read_whole_file(pipe), pipe + ": not a regular file");
}

// ---- file kind ----

using namespace std::string_literals;

TEST(FileKind, EveryShippedFileIsOfItsKind) {
  const std::pair<const char*, FileKind> folders[] = {{"orchestrator/stations", FileKind::station},
                                                      {"sequences", FileKind::sequence},
                                                      {"docs/maps", FileKind::table_map},
                                                      {"imu_io/frames", FileKind::frame},
                                                      {"turntable_drivers/modbus/maps", FileKind::register_map},
                                                      {"turntable_drivers/ascii/dialects", FileKind::dialect}};
  const std::set<std::string> endings = {".station", ".seq", ".map", ".frame", ".dialect"};
  int files = 0;
  for (const auto& [folder, kind] : folders)
    for (const auto& entry : std::filesystem::directory_iterator(std::string(TURNCAL_SOURCE_DIR "/") + folder)) {
      if (!endings.contains(entry.path().extension()) || entry.path().filename() == "twin.map") continue;
      ++files;
      EXPECT_EQ(recognise_file(entry.path()), kind) << entry.path();
    }
  EXPECT_GT(files, 30);
  const std::string samples = TURNCAL_SOURCE_DIR "/tests/imu_io/map_samples/";
  EXPECT_EQ(recognise_file(samples + "psins_imu.mat"), FileKind::mat);
  EXPECT_EQ(recognise_file(samples + "imu.h5"), FileKind::hdf5);
  for (const char* table : {"euroc.csv", "kf_gins.txt", "xsens.txt", "sbg.txt"})
    EXPECT_EQ(recognise_file(samples + table), FileKind::csv) << table;
}

TEST(FileKind, ByTheFirstBytes) {
  const std::pair<std::string, FileKind> cases[] = {
      {"\x89TCR....", FileKind::recording},
      {"\x89MCAP0\r\n", FileKind::mcap},
      {"#ROSBAG V2.0\n", FileKind::rosbag1},
      {"SQLite format 3\0..."s, FileKind::database},
      {"SQLite format 3\0... serialization_format TEXT"s, FileKind::rosbag2},
      {"\x93NUMPY\x01", FileKind::npy},
      {"\x1f\x8b\x08", FileKind::compressed},
      {"N01 = 1\nchecksum = 00000000\n", FileKind::parameters},
      {"verdict = clean\nquality.trusted = true\n", FileKind::diagnosis},
      {"# words\n  \nt;x;y\n1;+2.5e-3;3\n", FileKind::csv},
      {"1 2 3\n", FileKind::csv},
      {" {\"a\": 1}", FileKind::json},
      {"[{\"a\": 1}]", FileKind::json},
      {"<!doctype html><p>1, 2, 3", FileKind::page},
      {"some words, nothing else\n", FileKind::unknown},
      {"a = 1\nb = 2\n", FileKind::unknown},
      {"\0\1\2\3"s, FileKind::unknown},
      {"", FileKind::unknown}};
  for (const auto& [content, kind] : cases) EXPECT_EQ(recognise_content(content), kind) << content;
}

TEST(FileKind, SaysWhatItIsAndWhoTakesIt) {
  TemporaryFolder folder;
  const std::string csv = folder / "log.csv";
  write_file(csv, "t,x,y\n1,2,3\n");
  EXPECT_TRUE(fails(expect_file(csv, FileKind::parameters), ErrorKind::input,
                    csv + ": this is a table of numbers (CSV), expected a parameter file; turncal import " + csv +
                        " --out DIR takes it"));
  EXPECT_OK(expect_file(csv, FileKind::hdf5));  // both are tables
  EXPECT_OK(expect_file(folder / "none", FileKind::station));
  EXPECT_OK(expect_file(folder.path(), FileKind::station));
}

}  // namespace
}  // namespace turncal
