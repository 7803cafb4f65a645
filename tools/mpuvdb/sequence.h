// Sequences: a verb run once for each frame.
#pragma once
#include "command_line.h"

#include <string>
#include <vector>

namespace mpuvdb::command
{

/// The command line of the first frame that is to be made; @a words itself without --frames, and in
/// a frame's own process, whose names have their numbers.
std::vector<std::string> firstFrameOf(const std::vector<std::string>& words);

/// Runs the verb for every frame, --jobs of them at the same time, each in a process of its own: a
/// frame that fails, or crashes, stops no other one. What frames say is printed as it comes, with
/// their numbers; what they print on standard output comes in their order.
/// @param words  the whole command line; @param line  as parsed for firstFrameOf().
/// @return the exit status: the largest of the frames'. @throws UsageError before any work.
int runSequence(const std::vector<std::string>& words, const CommandLine& line);

/// The hidden option that makes a run a frame's own process; runSequence() gives it.
constexpr const char* kTaskOption = "--frame-task";

/// Runs the verb for the frame that kTaskOption tells of. @return the exit status.
int runFrame(const CommandLine& line);

} // namespace mpuvdb::command
