// The options of verbs that reconstruct from points, and what is said of the points.
#pragma once
#include "verb.h"

#include <mpuvdb/reconstruct.h>

#include <map>
#include <string>
#include <vector>

namespace mpuvdb::command
{

/// Points, how they are cleaned, fitted and sampled.
class CloudOptions
{
public:
    /// Declares the positionals.
    void addInputs(CLI::App& app);
    /// Declares the options of grid, fit and points.
    void addTo(CLI::App& app);
    /// Reads the points, and completes the options by what they have and by the session's limits.
    PointInput read(Session& session);
    /// Says what was done to the points.
    void describeCleaning(Session& session, const ReconstructReport& made) const;
    /// Puts settings and input into the report.
    void describeSettings(Session& session, const ReconstructReport& made) const;
    /// Prints what the settings came to.
    static void summarizeSettings(Session& session, const ReconstructReport& made);

    std::vector<std::string> inputs;
    ReconstructOptions options;
    Attributes attributes;
    Holes holes;
    bool coverage = false; ///< --coverage
    std::string preset;    ///< its name, or empty

private:
    void addGridOptions(CLI::App& app);
    void addFitOptions(CLI::App& app);
    void addPointOptions(CLI::App& app);

    std::string mNormals = "auto", mBadPoints = "drop", mOutliers = "drop";
    std::vector<std::string> mViewpoints;
    bool mFlipNormals = false;
};

} // namespace mpuvdb::command
