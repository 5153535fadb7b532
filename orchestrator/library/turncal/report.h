// A result for people: the text that the program prints, and the page that it writes.
#pragma once

#include <memory>
#include <string>

#include <turncal/error.h>

namespace turncal::v0 {

class TURNCAL_API Report {
 public:
  std::string text() const;  // plain ASCII, 100 columns
  std::string json() const;
  // Returns a page with style and plots inline. It starts gnuplot, with a limit of 15 s; without gnuplot a text replaces each plot.
  std::string html() const;

  struct Content;
  explicit Report(std::shared_ptr<const Content> content) : content_(std::move(content)) {}

 private:
  std::shared_ptr<const Content> content_;
};

}  // namespace turncal::v0
