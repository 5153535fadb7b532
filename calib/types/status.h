// Status and Result<T>: what every function at an I/O border returns.
//
// An Error carries its kind and one line for the user that says where, what was found and what was expected. A Result without a
// value never looks like success: both classes are [[nodiscard]], and value() on an error is a programming mistake (assert).
//
// Not for our own mistakes: those are assert().
#pragma once

#include <cassert>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include <fmt/core.h>

namespace turncal {

enum class ErrorKind {
  input,        // usage, configuration or input data
  unit_failed,  // the unit failed its limits, or a diagnosis is not clean
  aborted,      // by the operator
  device,       // device or link
  internal,     // our own mistake
  interrupted   // can be resumed
};

struct Error {
  ErrorKind kind = ErrorKind::internal;
  std::string message;
};

inline Error input_error(std::string message) { return {ErrorKind::input, std::move(message)}; }
template <class First, class... More>  // as fmt::format
Error input_error(fmt::format_string<First, More...> text, First&& first, More&&... more) {
  return {ErrorKind::input, fmt::format(text, std::forward<First>(first), std::forward<More>(more)...)};
}
inline Error device_error(std::string message) { return {ErrorKind::device, std::move(message)}; }

class [[nodiscard]] Status {
 public:
  Status() = default;  // success
  Status(Error error) : error_(std::move(error)) {}
  bool ok() const { return !error_.has_value(); }
  explicit operator bool() const { return ok(); }
  const Error& error() const {
    assert(error_);
    return *error_;
  }

 private:
  std::optional<Error> error_;
};

template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : content_(std::move(value)) {}
  Result(Error error) : content_(std::move(error)) {}
  bool ok() const { return std::holds_alternative<T>(content_); }
  explicit operator bool() const { return ok(); }
  T& value() {
    assert(ok());
    return *std::get_if<T>(&content_);
  }
  const T& value() const {
    assert(ok());
    return *std::get_if<T>(&content_);
  }
  T& operator*() { return value(); }
  const T& operator*() const { return value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }
  const Error& error() const {
    assert(!ok());
    return *std::get_if<Error>(&content_);
  }

 private:
  std::variant<T, Error> content_;
};

namespace detail {
inline void value_of(Status) {}
template <class T>
T value_of(Result<T> result) {
  return std::move(*result);
}
}  // namespace detail

}  // namespace turncal

// Yields the value of a Result, or nothing for a Status; on an error the enclosing function returns it.
//   const double sigma = TRY(read_sigma(file));
//   TRY(write(file));
#define TRY(...)                                   \
  __extension__({                                  \
    auto tried = (__VA_ARGS__);                    \
    if (!tried) return tried.error();              \
    ::turncal::detail::value_of(std::move(tried)); \
  })
