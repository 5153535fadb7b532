// A result as people read it: what the program prints, and the page it writes.
#pragma once

#include <memory>
#include <string>

#include <turncal/error.h>

namespace turncal::v0 {

class TURNCAL_API Report {
 public:
  std::string text() const;  // plain ASCII, 100 columns
  std::string json() const;
  // A page with style and plots inline. Drawn by gnuplot, which is started and gets 15 s; without it the page says so in place of each plot.
  std::string html() const;

  struct Content;
  explicit Report(std::shared_ptr<const Content> content) : content_(std::move(content)) {}

 private:
  std::shared_ptr<const Content> content_;
};

}  // namespace turncal::v0
