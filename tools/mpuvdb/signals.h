// Signals such as Ctrl-C: they stop the work, and end the process if it does not stop.
#pragma once

namespace mpuvdb
{
class Interrupter;
}

namespace mpuvdb::command
{

/// Makes SIGINT, SIGTERM and SIGHUP stop @a progress, which must outlive the process's work. If the
/// process has not ended 200 ms later, or at a second signal, temporary files are removed and it
/// exits with 128 + signal. SIGPIPE becomes a write error.
void stopOnSignals(Interrupter& progress);

/// The signal that stopped the work; 0 without one.
int stopSignal();

} // namespace mpuvdb::command
