// A station whose server is away goes on and keeps its rows; copies hold every row once; passwords stay out of names.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <chrono>

#include "tests/orchestrator/database/shared_database.h"

namespace turncal {
namespace {

using Outbox = SharedDatabase;

TEST_F(Outbox, AStationWhoseServerIsAwayGoesOnAndKeepsItsRows) {
  station(server_away);
  const ProgramResult result = run(dry_run("SN1"));
  ASSERT_EQ(result.code, 0) << result.err;
  const std::string log = file_text(folder_ / "east/SN1/run.log");
  EXPECT_SAYS(log, "127.0.0.1:1/turncal: results database: cannot open: ");
  EXPECT_SAYS(log, "; 1 attempt is kept in ");
  const std::string kept = path("east.station.outbox.db");
  ASSERT_EQ(run(dry_run("SN2")).code, 0);
  const std::vector<AttemptRecord> all = attempts(kept);
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0].outcome + all[1].outcome, "passpass");
  EXPECT_EQ(calibrations(kept), 2u);
  // What a person would do with it: into any other database, as often as wished.
  for (int i = 0; i < 2; ++i) ASSERT_EQ(run({"database", "copy", kept, "whole.db"}).code, 0);
  EXPECT_EQ(attempts(path("whole.db")).size(), 2u);
  EXPECT_EQ(run({"database", "check", "whole.db"}).code, 0);
}

TEST_F(Outbox, CheckWarnsOfAServerThatIsAwayAndDoesNotRefuse) {
  station(server_away);
  const ProgramResult result = run({"check", "--station", path("east.station"), "--sequence",
                                    std::string(TURNCAL_SOURCE_DIR) + "/sequences/fourteen_step.seq"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_SAYS(result.err, "warning: postgresql://east@127.0.0.1:1/turncal: results database: cannot open: ");
  EXPECT_EQ(result.err_lines(), 1) << result.err;
}

TEST_F(Outbox, ServerThatTakesAConnectionAndSaysNothingCostsSecondsOnly) {
  const int listener = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(::bind(listener, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(::listen(listener, 8), 0);
  socklen_t size = sizeof address;
  ::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  const auto began = std::chrono::steady_clock::now();
  const Result<ResultsDatabase> database =
      ResultsDatabase::open("postgresql://east@127.0.0.1:" + std::to_string(ntohs(address.sin_port)) + "/turncal",
                            {.wait_s = 1.0, .all_s = 2.0});
  ASSERT_FALSE(database.ok());
  EXPECT_EQ(database.error().kind, ErrorKind::device);
  EXPECT_SAYS(database.error().message, "there is no connection within 1 s");
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(2));
  ::close(listener);
}

TEST_F(Outbox, APasswordInANameIsRefusedAndNotRepeated) {
  for (const std::string name :
       {"postgresql://east:secret@host/turncal", "postgresql://east@host/turncal?password=secret",
        "postgresql://east:sec/secret@host/turncal"}) {
    station(name);
    for (const auto& command : {dry_run("SN1"), {"history", name}, {"shift", name}, {"database", "check", name}}) {
      const ProgramResult result = run(command);
      EXPECT_EQ(result.code, 1) << command.front();
      EXPECT_EQ(result.err_lines(), 1) << result.err;
      EXPECT_SAYS(result.err, "expected postgresql://USER@HOST/NAME, and the password in ~/.pgpass");
      EXPECT_SAYS_NOT((result.out + result.err), "secret") << result.out << result.err;
    }
  }
}

TEST_F(Outbox, CopyNeedsTwoDatabasesThatAreNotOne) {
  station("results.db");
  ASSERT_EQ(run(dry_run("SN1")).code, 0);
  expect_refused({"database", "copy", "results.db"}, "expected a second database");
  expect_refused({"database", "copy", "results.db", "results.db"}, "expected another file");
  expect_refused({"database", "check", "results.db", "other.db"}, "expected a second database with copy only");
  expect_refused({"database", "roles", "results.db"}, "a file has no roles");
  write("wrong.station", file_text(folder_ / "east.station") + "record.outbox = o.db\n");
  expect_refused("run --dry-run --unit SN2 --out x --station wrong.station", "record.outbox");
}

}  // namespace
}  // namespace turncal
