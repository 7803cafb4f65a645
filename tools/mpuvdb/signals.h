// Ctrl-C and its relatives: ask the work to stop, and see to it that it does.
#pragma once

namespace mpuvdb
{
class Interrupter;
}

namespace mpuvdb::command
{

/// From now on SIGINT, SIGTERM and SIGHUP stop @a progress, which must outlive the process's work.
/// If the process has not ended 200 ms later, or at a second signal, temporary files are removed
/// and it ends there and then with 128 + signal. SIGPIPE becomes a write error.
void stopOnSignals(Interrupter& progress);

/// The signal that asked for a stop; 0 if none did.
int stopSignal();

} // namespace mpuvdb::command
