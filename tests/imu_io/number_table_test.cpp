// .npy, .mat and CSV: as others write them, and as we do.
#include <matio.h>
#include "tests/test.h"

#include <bit>
#include <random>

#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/number_table.h"

namespace turncal {
namespace {

// As numpy.save writes it: magic, version 1.0, header padded to 64 bytes.
std::string npy(const std::string& type, bool column_major, const std::string& shape, const std::string& data) {
  std::string header =
      "{'descr': '" + type + "', 'fortran_order': " + (column_major ? "True" : "False") + ", 'shape': " + shape + ", }";
  while ((10 + header.size() + 1) % 64 != 0) header += ' ';
  header += '\n';
  std::string text("\x93NUMPY\x01\x00", 8);
  text += char(header.size() & 0xFF);
  text += char(header.size() >> 8);
  return text + header + data;
}
template <class T>
std::string bytes_of(const std::vector<T>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

TEST(NumberTable, ReadsNumpyArraysOfEitherOrder) {
  const std::vector<double> rows = {1, 2, 3, 4, 5, 6};  // 3 x 2
  for (const bool column_major : {false, true}) {
    const std::vector<double> data = column_major ? std::vector<double>{1, 3, 5, 2, 4, 6} : rows;
    const auto table =
        good(read_number_table(npy("<f8", column_major, "(3, 2)", bytes_of(data)), "a.npy", {{"2"}, {"1"}}, {}));
    EXPECT_EQ(table->columns[0], (std::vector<double>{2, 4, 6}));
    EXPECT_EQ(table->columns[1], (std::vector<double>{1, 3, 5}));
  }
  const auto counts = good(read_number_table(npy("<i2", false, "(3,)", bytes_of(std::vector<std::int16_t>{-7, 0, 9})),
                                             "a.npy", {{"1"}}, {}));
  EXPECT_EQ(counts->columns[0], (std::vector<double>{-7, 0, 9}));
}

// Decimal numbers of 1 to 20 digits, with and without sign, point and exponent, are those of the standard library to the last bit.
TEST(NumberTable, NumbersOfATextAreRoundedOnce) {
  std::mt19937 random(7);
  const auto below = [&](unsigned n) { return unsigned(random() % n); };
  std::string text = "x\n-0.0\n.5\n5.\n-.25\n0\n9007199254740993\n0.1234567890123456\n999999999999999\n";
  for (int k = 0; k < 20000; ++k) {
    std::string number = below(2) == 0 ? "-" : "";
    const unsigned digits = 1 + below(20), point = below(2 * digits);
    for (unsigned d = 0; d < digits; ++d) number += (d == point ? "." : "") + std::string(1, char('0' + below(10)));
    if (below(8) == 0) number += "e" + std::to_string(int(below(40)) - 20);
    text += number + "\n";
  }
  const auto table = good(read_number_table(text, "a.csv", {{"x"}}, {}));
  std::string_view left = text;
  next_line(left);
  for (const double value : table->columns[0]) {
    const std::string_view line = next_line(left);
    double expected = NAN;
    std::from_chars(line.data(), line.data() + line.size(), expected);
    ASSERT_EQ(std::bit_cast<std::uint64_t>(value), std::bit_cast<std::uint64_t>(expected)) << line;
  }
  EXPECT_TRUE(left.empty());
}

// A matrix of rows, a struct in a struct, as imu.gyro and imu.meta.t; and a file of HDF5 (tests/imu_io/map_samples): chunks, deflate, both byte orders, a compound.
TEST(NumberTable, ReadsMatlabVariablesAndHdf5) {
  TemporaryFolder folder;
  const std::string file = folder / "nested.mat";
  mat_t* mat = Mat_CreateVer(file.c_str(), nullptr, MAT_FT_MAT5);
  ASSERT_NE(mat, nullptr);
  double gyro[] = {1, 2, 3, 4, 5, 6}, t[] = {0.0, 0.1, 0.2}, both[] = {1, 4, 2, 5, 3, 6};
  std::size_t size[] = {3, 2}, one[] = {1, 1}, column[] = {3, 1}, row[] = {2, 3};
  const char* fields[] = {"gyro", "meta"};
  const char* inner[] = {"t"};
  matvar_t* meta = Mat_VarCreateStruct("meta", 2, one, inner, 1);
  Mat_VarSetStructFieldByName(meta, "t", 0, Mat_VarCreate("t", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, column, t, 0));
  matvar_t* imu = Mat_VarCreateStruct("imu", 2, one, fields, 2);
  Mat_VarSetStructFieldByName(imu, "gyro", 0, Mat_VarCreate("gyro", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, size, gyro, 0));
  Mat_VarSetStructFieldByName(imu, "meta", 0, meta);
  matvar_t* wide = Mat_VarCreate("wide", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, row, both, 0);
  for (matvar_t* variable : {imu, wide}) {
    EXPECT_EQ(Mat_VarWrite(mat, variable, MAT_COMPRESSION_ZLIB), 0);
    Mat_VarFree(variable);
  }
  Mat_Close(mat);
  const auto table = good(read_number_table("MATLAB 5.0", file, {{"imu.gyro:2"}, {"imu.meta.t"}, {"wide:2"}}, {}));
  EXPECT_EQ(table->columns[0], (std::vector<double>{4, 5, 6}));
  EXPECT_EQ(table->columns[1], (std::vector<double>{0.0, 0.1, 0.2}));
  EXPECT_EQ(table->columns[2], (std::vector<double>{4, 5, 6}));
  EXPECT_EQ(expect_value(column_names(bytes_of_text("MATLAB 5.0"), file)),
            (std::vector<std::string>{"imu.gyro:1", "imu.gyro:2", "imu.meta.t", "wide:1", "wide:2"}));
  EXPECT_TRUE(fails(read_number_table("MATLAB 5.0", file, {{"imu.nope"}}, {}), "no variable 'imu.nope' of numbers"));
  const std::string hdf5 = "\x89HDF\r\n\x1a\n", sample = TURNCAL_SOURCE_DIR "/tests/imu_io/map_samples/imu.h5";
  const auto imu5 = good(
      read_number_table(hdf5, sample, {{"imu/gyro:2"}, {"imu/acc:3"}, {"imu/time_ns"}, {"housekeeping:celsius"}}, {}));
  EXPECT_EQ(imu5->columns[0][59], 0.01);
  EXPECT_NEAR(imu5->columns[1][0], 9.8, 1e-6);
  EXPECT_EQ(imu5->columns[2][1], 100010000000.0);
  EXPECT_EQ(imu5->columns[3][30], 25.5);
  EXPECT_EQ(expect_value(column_names(bytes_of_text(hdf5), sample)).size(), 9u);
  for (const auto& [name, what] : {std::pair("imu/nope", "no dataset 'imu/nope'"),
                                   {"imu/gyro:4", "from 1 to 3"},
                                   {"housekeeping:x", "expected numbers"},
                                   {"imu", "no dataset"}})
    EXPECT_TRUE(fails(read_number_table(hdf5, sample, {{name}}, {}), what));
  std::string bytes = file_text(sample);
  for (std::size_t cut : {9UL, 100UL, 2000UL, 9000UL}) {
    write_file(folder / "cut.h5", bytes.substr(0, cut));
    EXPECT_FALSE(read_number_table(hdf5, folder / "cut.h5", {{"imu/gyro:2"}}, {}).ok()) << cut;
  }
}

// Of a sparse matrix the numbers lie elsewhere.
TEST(NumberTable, ASparseMatrixIsRefused) {
  TemporaryFolder folder;
  const std::string path = folder / "sparse.mat";
  mat_t* const file = Mat_CreateVer(path.c_str(), nullptr, MAT_FT_MAT5);
  double values[] = {1.0, 2.0};
  std::uint32_t rows[] = {0, 1}, columns[] = {0, 1, 2};
  mat_sparse_t content{};
  content.nzmax = content.nir = content.ndata = 2;
  content.njc = 3;
  content.ir = rows, content.jc = columns, content.data = values;
  std::size_t size[2] = {2, 2};
  matvar_t* const variable = Mat_VarCreate("s", MAT_C_SPARSE, MAT_T_DOUBLE, 2, size, &content, MAT_F_DONT_COPY_DATA);
  Mat_VarWrite(file, variable, MAT_COMPRESSION_NONE);
  Mat_VarFree(variable);
  Mat_Close(file);
  EXPECT_TRUE(fails(read_number_table("MATLAB ", path, {{"s:1"}}, {}), "expected a real matrix"));
  EXPECT_TRUE(expect_value(column_names(bytes_of_text("MATLAB 5.0"), path)).empty());
}

// Of a .mat file every byte counts: one that is missing, and, where it is compressed, one that is changed.
TEST(NumberTable, MatlabFilesAreWholeOrRefused) {
  TemporaryFolder folder;
  const std::string path = folder / "a.mat";
  for (const auto compression : {MAT_COMPRESSION_NONE, MAT_COMPRESSION_ZLIB}) {
    std::mt19937 random(3);
    std::normal_distribution<double> noise;
    mat_t* const file = Mat_CreateVer(path.c_str(), nullptr, MAT_FT_MAT5);
    for (const char* name : {"t", "w"}) {
      std::vector<double> values(500);
      for (double& value : values) value = noise(random);
      std::size_t size[2] = {values.size(), 1};
      matvar_t* const variable = Mat_VarCreate(name, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, size, values.data(), 0);
      Mat_VarWrite(file, variable, compression);
      Mat_VarFree(variable);
    }
    Mat_Close(file);
    const std::string whole = *read_whole_file(path);
    const auto read = [&](const std::string& content) {
      std::ofstream(path, std::ios::binary) << content;
      return read_number_table("MATLAB ", path, {{"t"}, {"w"}}, {});
    };
    const NumberTable right = expect_value(read(whole));
    const std::size_t second = whole.size() / 2;  // the first variable is whole
    for (std::size_t size = second; size < whole.size(); size += 1 + size % 97)
      EXPECT_TRUE(fails(read(whole.substr(0, size)), "the .mat file is cut off")) << size;
    for (std::size_t at = 150; compression == MAT_COMPRESSION_ZLIB && at < whole.size(); at += 1 + at % 97) {
      std::string changed = whole;
      changed[at] = char(changed[at] ^ 8);
      const Result<NumberTable> table = read(changed);  // a bit that only fills up says nothing
      EXPECT_TRUE(!table.ok() || table->columns == right.columns) << at;
    }
  }
}

// A number that is cut off is another number.
TEST(NumberTable, ALastLineWithoutAnEndIsLeftOut) {
  const std::string text = "a,b\n1,1.5e-2\n2,1.5";
  const auto table = good(read_number_table(text, "d.csv", {{"a"}, {"b"}}, {}));
  EXPECT_EQ(table->columns[1], std::vector<double>{0.015});
  EXPECT_EQ(table->bad_rows, 1);
  EXPECT_SAYS(table->first_bad, "d.csv:3: the last line has no end");
  EXPECT_EQ(good(read_number_table(text + "\n", "d.csv", {{"a"}}, {}))->rows(), 2u);
  EXPECT_TRUE(fails(read_number_table(text, "d.csv", {{"a"}}, {.whole_rows = true}), "d.csv:3: the last line"));
}

// A name is of the cell that stands below it, a number of the cell that stands there in the other rows.
TEST(NumberTable, RowsWithACellMoreOrLess) {
  const auto read = [](const std::string& rows, const char* column) {
    return read_number_table("a,b,c\n" + rows, "d.csv", {{column}}, {});
  };
  EXPECT_TRUE(
      fails(read("1,2,3\n1,5,2,3\n", "b"), "d.csv:3: the row has 4 columns: expected 3, as the header has names"));
  EXPECT_OK(read("1,2,3,\n4,5,6,,\n", "b"));
  EXPECT_TRUE(fails(read("1,2,3\n1,5\n", "b"), "d.csv:3: the row has 2 columns: expected 3, as the header has names"));
  EXPECT_TRUE(fails(read("1,2\n1,5,3\n", "2"), "d.csv:3: the row has 3 columns: expected 2, as the first row has"));
  EXPECT_OK(read("1,2,3,4\n4,5,6,7,\n", "2"));
}

TEST(NumberTable, RowsThatAreNotFiniteAreSkippedWhereThatIsWanted) {
  const std::string content = npy("<f8", false, "(3, 2)", bytes_of(std::vector<double>{1, 2, NAN, 4, 5, 6}));
  EXPECT_TRUE(fails(read_number_table(content, "a.npy", {{"2"}, {"1"}}, {}),
                    "a.npy: row 2: column '1' = 'nan': expected a finite number"));
  const auto table = good(read_number_table(content, "a.npy", {{"2"}, {"1"}}, {.skip_bad_rows = true}));
  EXPECT_EQ(table->columns[0], (std::vector<double>{2, 6}));
  EXPECT_EQ(table->position, (std::vector<std::int64_t>{0, 2}));
  EXPECT_EQ(table->bad_rows, 1);
}

const std::vector<NumberColumn> sample_columns = {{"time_s", {0.0, 0.1, 1e300}}, {"x.y", {-1.0, 1.0 / 3.0, 7.0}}};

TEST(MatrixWriter, IsReadAgain) {
  TemporaryFolder folder;
  for (const char* name : {"a.npy", "a.mat", "a.csv"}) {
    const std::string path = folder / name;
    ASSERT_OK(write_columns(path, sample_columns));
    const std::string text = file_text(path);
    const std::string form = path.substr(path.size() - 3);
    const std::vector<WantedColumn> wanted = form == "npy"   ? std::vector<WantedColumn>{{"1"}, {"2"}}
                                             : form == "mat" ? std::vector<WantedColumn>{{"time_s"}, {"x_y"}}
                                                             : std::vector<WantedColumn>{{"time_s"}, {"x.y"}};
    const auto table = good(read_number_table(text, path, wanted, {}));
    for (std::size_t k = 0; k < 2; ++k) EXPECT_EQ(table->columns[k], sample_columns[k].values) << name;
    // Again: the same bytes; nothing beside it.
    ASSERT_TRUE(write_columns(path, sample_columns).ok());
    EXPECT_EQ(file_text(path), text);
  }
  // The data of a .npy begin on a multiple of 64 bytes.
  const std::string npy = file_text(folder / "a.npy");
  EXPECT_EQ((npy.size() - 6 * 8) % 64, 0u);
  EXPECT_EQ(folder.names().size(), 3u);
}

TEST(MatrixWriter, ReplacesOnlyItsLike) {
  TemporaryFolder folder;
  for (const char* name : {"a.npy", "a.mat", "a.csv"}) {
    write_file(folder / name, "precious");
    ASSERT_TRUE(fails(write_columns(folder / name, sample_columns), ErrorKind::input));
    EXPECT_EQ(file_text(folder / name), "precious");
    EXPECT_FALSE(write_columns(folder / ("nowhere/" + std::string(name)), sample_columns).ok());
  }
}

TEST(NumberTable, SaysWhatIsNoTable) {
  const auto said = [](std::string_view content, std::string_view what, const char* column = "1") {
    return fails(read_number_table(content, "f", {{column}}, {.header_lines = 0}), what);
  };
  EXPECT_TRUE(said(std::string_view("\xFF\xFE,\0,\0", 6), "f: a text in UTF-16 or UTF-32: expected UTF-8"));
  EXPECT_TRUE(said("1,2\r3,4\r", "f: lines end in a carriage return alone: expected line feeds"));
  EXPECT_TRUE(
      said(std::string_view("\0\0\0\0\7\0\0\0\1\0\0\0\0\0\0\0\2\0\0\0t\0", 22), "f: a MATLAB file of version 4"));
  EXPECT_TRUE(said(npy("<f8", false, "(0, 7)", ""), "f: shape '(0, 7)': an empty array"));
  const std::string six = bytes_of(std::vector<double>{1, 2, 3, 4, 5, 6});
  EXPECT_TRUE(said(npy(">f8", false, "(3, 2)", six), "little-endian"));
  EXPECT_TRUE(said(npy("<f8", false, "(1, 3, 2)", six), "one or two dimensions"));
  EXPECT_TRUE(said(npy("<f8", false, "(4, 2)", six), "cut off"));
  EXPECT_TRUE(said(npy("<f8", false, "(3, 2)", six), "from 1 to 2", "3"));
  EXPECT_TRUE(said(std::string_view("\x93NUMPY\x01\x00\xFF\xFF", 10), "cut off"));
}

// In blocks, from a file, of either order and of text, the rows are those of the whole; the second time, too.
TEST(NumberTable, BlocksAreTheTable) {
  TemporaryFolder folder;
  std::vector<double> rows, columns(3 * 70000);
  std::string text = "a,b,c\n";
  for (std::size_t k = 0; k < 70000; ++k)
    for (std::size_t c = 0; c < 3; ++c) {
      rows.push_back(double(k * 10 + c));
      columns[c * 70000 + k] = rows.back();
      text += std::to_string(k * 10 + c) + (c < 2 ? "," : "\n");
    }
  const std::string files[] = {npy("<f8", false, "(70000, 3)", bytes_of(rows)),
                               npy("<f8", true, "(70000, 3)", bytes_of(columns)), text};
  for (const std::string& content : files) {
    std::ofstream(folder / "t", std::ios::binary) << content;
    const TableBytes bytes = expect_value(bytes_of_file(folder / "t"));
    for (int pass = 0; pass < 2; ++pass) {
      std::size_t row = 0, blocks = 0;
      EXPECT_OK(read_number_table(bytes, "t", {{"3"}, {"1"}}, {}, [&](const NumberTable& block) {
        for (std::size_t k = 0; k < block.rows(); ++k, ++row) {
          EXPECT_EQ(block.columns[0][k], double(row * 10 + 2));
          EXPECT_EQ(block.columns[1][k], double(row * 10));
          EXPECT_EQ(block.position[k], std::int64_t(row));
        }
        ++blocks;
        return Status();
      }));
      EXPECT_EQ(row, 70000u);
      EXPECT_GT(blocks, 1u);
    }
  }
}

}  // namespace
}  // namespace turncal
