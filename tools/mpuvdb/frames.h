// Sequences of files: "1-24" and "name.####.vdb".
#pragma once
#include <string>
#include <vector>

namespace mpuvdb::command
{

/// The frame that a run makes, and the sequence that it belongs to.
struct Frame {
    int number = 0;
    int first = 0, last = 0;         ///< of the whole sequence
    std::vector<std::string> shared; ///< options of outputs that are one file for all frames

    /// How far the frame is through the sequence, from 0 to 1; 0 in a sequence of one.
    double position() const { return last > first ? double(number - first) / (last - first) : 0; }
};

/// The frames of "7", "1-24" or "1-24x2", in order. @throws UsageError.
std::vector<int> parseFrames(const std::string& text);

/// Whether @a pattern has a place for the frame's number: "####", "%04d", "%d", "$F4" or "$F".
bool hasFrame(const std::string& pattern);

/// Whether @a text can only be a pattern: a single "#" may be part of a name.
bool isFramePattern(const std::string& text);

/// @a pattern with the number of @a frame in all its places, padded with zeros to their widths.
std::string frameFile(const std::string& pattern, int frame);

} // namespace mpuvdb::command
