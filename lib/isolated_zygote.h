// SPDX-License-Identifier: Apache-2.0
// The process that forks a child for each file.  Internal: not installed.
#pragma once

#include <sys/types.h>

#include <string>

namespace envconv {

/// Has the zygote, which is started first when there is none, fork a child that decodes `file` and talks over `socket`;
/// `request` is a message of MessageKind::request.  Both descriptors stay the caller's.  The zygote's process, or -1
/// when it could not be asked.
pid_t ask_zygote(const std::string& request, int file, int socket);

/// The next request goes to a new one.
void forget_zygote();

}  // namespace envconv
