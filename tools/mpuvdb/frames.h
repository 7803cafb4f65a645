// Sequences of files: "1-24" and "name.####.vdb".
#pragma once
#include <string>
#include <vector>

namespace mpuvdb::command
{

/// The frames of "7", "1-24" or "1-24x2", in order. @throws UsageError.
std::vector<int> parseFrames(const std::string& text);

/// Whether @a pattern has a place for the frame's number: "####", "%04d", "%d", "$F4" or "$F".
bool hasFrame(const std::string& pattern);

/// @a pattern with the number of @a frame, padded with zeros to the pattern's width.
std::string frameFile(const std::string& pattern, int frame);

} // namespace mpuvdb::command
