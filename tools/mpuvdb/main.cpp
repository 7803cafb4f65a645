// The command mpuvdb: one verb, one exit status.
#include "command_line.h"
#include "memory_limit.h"
#include "run_verb.h"
#include "sequence.h"
#include "standard_output.h"

#include <cstdio>

int main(int argc, char** argv)
{
    using namespace mpuvdb;
    command::keepStandardFiles();
    command::reuseFreedMemory();
    try {
        const std::vector<std::string> words(argv, argv + argc);
        const command::CommandLine line = command::parseCommandLine(command::firstFrameOf(words));
        if (!line.verb) return int(command::ExitCode::Ok);
        if (!line.options.task.empty()) return command::runFrame(line);
        return line.options.frames.empty() ? command::runVerb(*line.verb, line.options)
                                           : command::runSequence(words, line);
    } catch (const Error& e) {
        std::fprintf(stderr, "%s\n", e.what());
        return int(command::exitCodeOf(e));
    } catch (const std::exception& e) {
        std::fprintf(stderr, "mpuvdb: internal error: %s\n", e.what());
        return int(command::ExitCode::Internal);
    }
}
