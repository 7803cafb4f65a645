// The command mpuvdb: one verb, one exit status.
#include "command_line.h"
#include "memory_limit.h"
#include "signals.h"
#include "standard_output.h"

#include <cstdio>
#include <fmt/format.h>
#include <new>
#include <openvdb/openvdb.h>
#include <system_error>

namespace mpuvdb::command
{
namespace
{

int interruptedStatus()
{
    return stopSignal() ? 128 + stopSignal() : int(ExitCode::Interrupted);
}

int outOfMemory(Session& session)
{
    session.fail("LimitError",
                 fmt::format("out of memory (limit {}): raise --max-memory, or use larger voxels",
                             sizeText(session.options().maxBytes)));
    return int(ExitCode::Limit);
}

/// Calls @a work; prints and reports its exceptions. @return the exit status.
template <typename Work>
int guarded(Session& session, const Work& work)
{
    try {
        return int(work());
    } catch (const Interrupted& e) {
        session.fail(e.type(), e.what());
        return interruptedStatus();
    } catch (const Error& e) {
        session.fail(e.type(), e.what());
        return int(exitCodeOf(e));
    } catch (const std::bad_alloc&) {
        return outOfMemory(session);
    } catch (const std::exception& e) {
        // No room for another thread's stack.
        const auto* const system = dynamic_cast<const std::system_error*>(&e);
        if (system && system->code() == std::errc::resource_unavailable_try_again)
            return outOfMemory(session);
        session.fail("InternalError", fmt::format("internal error: {}", e.what()));
        return int(ExitCode::Internal);
    }
}

int runVerb(Verb& verb, const CommonOptions& options)
{
    Session session(verb.text().name, options);
    const int status = guarded(session, [&] {
        stopOnSignals(session.progress());
        openvdb::initialize();
        return verb.run(session);
    });
    const int reported = guarded(session, [&] {
        session.writeReport();
        return ExitCode::Ok;
    });
    return status ? status : reported;
}

} // namespace
} // namespace mpuvdb::command

int main(int argc, char** argv)
{
    using namespace mpuvdb;
    command::keepStandardFiles();
    command::reuseFreedMemory();
    try {
        const command::CommandLine line = command::parseCommandLine(argc, argv);
        return line.verb ? command::runVerb(*line.verb, line.options) : int(command::ExitCode::Ok);
    } catch (const Error& e) {
        std::fprintf(stderr, "%s\n", e.what());
        return int(command::exitCodeOf(e));
    } catch (const std::exception& e) {
        std::fprintf(stderr, "mpuvdb: internal error: %s\n", e.what());
        return int(command::ExitCode::Internal);
    }
}
