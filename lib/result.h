// SPDX-License-Identifier: Apache-2.0
// Errors as values: the library neither throws across its interface, nor prints, nor exits.
#pragma once

#include <string>
#include <utility>
#include <variant>

namespace envconv {

/// What kind of thing went wrong.  The numbers are the tool's exit statuses (envconv(1), EXIT STATUS).
enum class ErrorCode {
  threshold = 1,    ///< a limit that was asked for is not kept; nothing else failed
  usage = 2,        ///< the request itself is wrong; nothing was read
  input = 3,        ///< an input is missing, unreadable, damaged or not what it was said to be
  output = 4,       ///< an output could not be written; no partial file is left
  unsupported = 5,  ///< the combination is not supported (a format that cannot hold it, say)
  limit = 6,        ///< a limit on memory or image size would be exceeded
  internal = 70,    ///< a bug in envconv
};

/// One line for a person: `FILE: what is wrong (what to do)`, without the program's name and without a newline.
struct Error {
  ErrorCode code = ErrorCode::internal;
  std::string message{};
  int system = 0;  ///< errno of the system call that failed, or 0
};

/// Nothing, successfully.
struct Ok {};

/// Either a T or the Error that prevented it.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}      // NOLINT: implicit on purpose
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}  // NOLINT: implicit on purpose

  bool ok() const { return state_.index() == 0; }
  explicit operator bool() const { return ok(); }
  /// Precondition: ok().
  T& operator*() { return std::get<0>(state_); }
  const T& operator*() const { return std::get<0>(state_); }
  T* operator->() { return &std::get<0>(state_); }
  const T* operator->() const { return &std::get<0>(state_); }
  /// Precondition: !ok().
  const Error& error() const { return std::get<1>(state_); }

 private:
  std::variant<T, Error> state_;
};

}  // namespace envconv

#define ENVCONV_CONCAT_(a, b) a##b
#define ENVCONV_CONCAT(a, b) ENVCONV_CONCAT_(a, b)
/// `ENVCONV_TRY(auto x, f());` declares x from f()'s value, or returns f()'s error from the enclosing function.
#define ENVCONV_TRY(declaration, ...)                                                                         \
  auto ENVCONV_CONCAT(result_, __LINE__) = (__VA_ARGS__);                                                     \
  if (!ENVCONV_CONCAT(result_, __LINE__)) return ::envconv::Error(ENVCONV_CONCAT(result_, __LINE__).error()); \
  declaration = std::move(*ENVCONV_CONCAT(result_, __LINE__))
/// The same for a result whose value is not needed.
#define ENVCONV_CHECK(...)                                  \
  do {                                                      \
    auto result_ = (__VA_ARGS__);                           \
    if (!result_) return ::envconv::Error(result_.error()); \
  } while (false)
