// SPDX-License-Identifier: Apache-2.0
// Preconditions and invariants that only a bug in envconv, or in a program that uses it, can break.  They are checked
// where ENVCONV_ASSERTIONS is defined (debug builds, and those with a sanitizer) and cost nothing elsewhere; what a
// user or a file can get wrong is an Error instead (result.h).
//
// The file is not called assert.h: its folder is on the path that <cassert> looks for <assert.h> on.
#pragma once

#ifdef ENVCONV_ASSERTIONS

#include <cstdio>
#include <cstdlib>

namespace envconv {
/// The one place where the library prints: a failed assertion is no result that it could return.
[[noreturn]] inline void assertion_failed(const char* file, int line, const char* condition) {
  std::fprintf(stderr, "%s:%d: a bug in envconv: this does not hold: %s\n", file, line, condition);
  std::abort();
}
}  // namespace envconv

/// Ends the program when the condition does not hold.
#define ENVCONV_ASSERT(...) \
  (static_cast<bool>(__VA_ARGS__) ? void() : ::envconv::assertion_failed(__FILE__, __LINE__, #__VA_ARGS__))

#else

// Compiled, so that it stays valid, and never evaluated.
#define ENVCONV_ASSERT(...) static_cast<void>(sizeof(static_cast<bool>(__VA_ARGS__)))

#endif
