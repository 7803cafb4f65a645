#include "signals.h"

#include "standard_output.h"

#include "files/atomic_file.h"
#include "files/atomic_folder.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fmt/format.h>
#include <sys/eventfd.h>
#include <thread>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

constexpr std::chrono::milliseconds kGracePeriod{200};

std::atomic<Interrupter*> theProgress{nullptr};
std::atomic<int> theSignal{0};
int theStopEvent = -1; // an eventfd from the handler to the watchdog

[[noreturn]] void leaveNow() noexcept
{
    removeTemporaryFiles();
    removeTemporaryFolder();
    removeScratchFolders();
    _exit(128 + theSignal.load());
}

extern "C" void onStopSignal(int signal)
{
    const int savedErrno = errno;
    int none = 0;
    if (!theSignal.compare_exchange_strong(none, signal)) leaveNow();
    theProgress.load()->stop();
    const std::uint64_t ring = 1;
    [[maybe_unused]] const ssize_t written = write(theStopEvent, &ring, sizeof ring);
    errno = savedErrno;
}

void watch()
{
    std::uint64_t rings = 0;
    while (read(theStopEvent, &rings, sizeof rings) < 0 && errno == EINTR) {
    }
    std::this_thread::sleep_for(kGracePeriod);
    leaveNow();
}

/// A process started with a signal ignored (nohup, a script's background job) keeps it ignored.
void handle(int signal)
{
    struct sigaction action {
    };
    sigaction(signal, nullptr, &action);
    if (action.sa_handler == SIG_IGN) return;
    action.sa_handler = onStopSignal;
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    sigaction(signal, &action, nullptr);
}

} // namespace

void stopOnSignals(Interrupter& progress)
{
    theProgress = &progress;
    theStopEvent = eventfd(0, EFD_CLOEXEC);
    if (theStopEvent < 0)
        throw IoError(fmt::format("cannot make an eventfd: {}", std::strerror(errno)));
    std::thread(watch).detach();
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) handle(signal);
    // Writing fails instead, and unfinished files are removed.
    for (const int signal : {SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_IGN);
}

int stopSignal()
{
    return theSignal.load();
}

} // namespace mpuvdb::command
