#include "orchestrator/watch/status_page.h"

#include <atomic>
#include <chrono>
#include <thread>

#include "imu_io/base/clock.h"
#include "orchestrator/watch/page_server.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

extern const std::string_view status_page_html;  // status_page.html; INITIAL in it stands for the first status

namespace {

constexpr double shown_for_s = 0.2;

}  // namespace

struct StatusPage::State {
  std::unique_ptr<PageServer> server;
  std::atomic<long> polls{0};  // answered with what is newer than `fresh_s`
  std::atomic<double> polled_s{-1e9};
  std::atomic<double> fresh_s{-1e9};
};

StatusPage::StatusPage() : state_(std::make_unique<State>()) {}
StatusPage::~StatusPage() = default;

void StatusPage::say_goodbye() {
  const double began_s = monotonic_s();
  if (began_s - state_->polled_s > 5.0) return;
  state_->fresh_s = began_s;
  const long polls = state_->polls;
  while (state_->polls == polls && monotonic_s() - began_s < 3.0)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the answer is on its way
}

std::string StatusPage::url() const { return state_->server->url(); }

std::string StatusPage::warning() const {
  if (state_->server->loopback()) return "";
  return "warning: whoever reaches " + url() +
         " can read the status page: it has no access control and is not encrypted";
}

Result<std::unique_ptr<StatusPage>> StatusPage::open(const std::string& address, const LiveStatus& run) {
  std::unique_ptr<StatusPage> page(new StatusPage);
  State& state = *page->state_;
  // However often it is asked for, the status is locked and written out a few times a second. Only the server's thread comes here.
  struct Newest {
    std::string json;
    double rendered_s = -1e9;
  };
  const auto newest = std::make_shared<Newest>();
  const auto status = [&run, &state, newest]() -> const std::string& {
    const double now_s = monotonic_s();
    if (now_s - newest->rendered_s > shown_for_s || newest->rendered_s < state.fresh_s) *newest = {run.json(), now_s};
    return newest->json;
  };
  const auto pages = [&state, status](std::string_view path) -> std::optional<PageText> {
    if (path == "/") {
      // With the first status in it the page shows something at once and without a second request.
      std::string html(status_page_html);
      return PageText{"text/html; charset=utf-8", html.replace(html.find("INITIAL"), 7, status())};
    }
    if (path != "/status.json") return {};
    PageText text{"application/json", status()};
    state.polled_s = monotonic_s();
    ++state.polls;
    return text;
  };
  std::unique_ptr<PageServer> server = TRY(PageServer::open(address, pages));
  state.server = std::move(server);
  return page;
}

}  // namespace turncal
