#include "run_verb.h"

#include "memory_limit.h"
#include "scratch_memory.h"
#include "signals.h"

#include <cerrno>
#include <cstring>
#include <fmt/format.h>
#include <new>
#include <openvdb/openvdb.h>

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

} // namespace

int guarded(Session& session, const std::function<ExitCode()>& work)
{
    try {
        return int(work());
    } catch (const Interrupted& e) {
        session.fail(e.type(), e.what());
        return interruptedStatus();
    } catch (const Error& e) {
        session.fail(e.type(), e.what());
        return int(exitCodeOf(e));
    } catch (const ScratchFull& e) {
        session.fail("IoError", fmt::format("{}. Free some space, raise --max-memory, or write to "
                                            "another disk",
                                            e.what()));
        return int(ExitCode::TryAgain);
    } catch (const std::bad_alloc&) {
        return outOfMemory(session);
    } catch (const std::exception& e) {
        // No room for another thread's stack, or for another process: TBB's error has but the text.
        if (std::strstr(e.what(), std::strerror(EAGAIN))) return outOfMemory(session);
        session.fail("InternalError", fmt::format("internal error: {}", e.what()));
        return int(ExitCode::Internal);
    }
}

int runVerb(Verb& verb, const CommonOptions& options, std::string* report)
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
    if (report) *report = session.reportText();
    return status ? status : reported;
}

std::optional<NamedFiles> namedFiles(Verb& verb, CommonOptions options)
{
    options.quiet = true;
    options.progress = "none";
    Session session(verb.text().name, options, Session::Purpose::NameFiles);
    try {
        verb.run(session);
    } catch (const NamedFiles& files) {
        return files;
    }
    return {};
}

} // namespace mpuvdb::command
