#include "sequence.h"

#include "frame_process.h"
#include "frames.h"
#include "run_verb.h"
#include "standard_output.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <iterator>
#include <list>
#include <poll.h>
#include <sched.h>
#include <sys/signalfd.h>
#include <system_error>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

using Json = nlohmann::ordered_json;
using Words = std::vector<std::string>;
using Clock = std::chrono::steady_clock;

/// @a words with the number of @a frame in all places for it.
Words wordsOf(const Words& words, int frame)
{
    Words placed;
    placed.reserve(words.size());
    for (const std::string& word : words) placed.push_back(frameFile(word, frame));
    return placed;
}

/// The frames to make. @throws UsageError where --only is none of them.
std::vector<int> chosenFrames(const CommonOptions& options)
{
    const std::vector<int>& all = options.frames;
    if (!options.only) return all;
    if (std::find(all.begin(), all.end(), *options.only) == all.end())
        throw UsageError(fmt::format("--only {}: is not in --frames", *options.only));
    return {*options.only};
}

/// The processors that this process may use.
int processors()
{
    cpu_set_t set;
    CPU_ZERO(&set);
    return sched_getaffinity(0, sizeof set, &set) == 0 ? std::max(1, CPU_COUNT(&set)) : 1;
}

/// Writes @a bytes to @a file as far as there is room: a frame may go without a report.
void writeBytes(int file, const std::string& bytes)
{
    for (std::size_t done = 0; done < bytes.size();) {
        const ssize_t n = write(file, bytes.data() + done, bytes.size() - done);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return;
        done += std::size_t(n);
    }
}

/// The signals that end a sequence, but those that this process was started to ignore (nohup).
sigset_t stopSignals()
{
    sigset_t signals;
    sigemptyset(&signals);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
        struct sigaction action {
        };
        sigaction(signal, nullptr, &action);
        if (action.sa_handler != SIG_IGN) sigaddset(&signals, signal);
    }
    return signals;
}

/// A frame of @a frames beside @a frame, or the one after it.
int otherFrame(const std::vector<int>& frames, int frame)
{
    const auto other =
        std::find_if(frames.begin(), frames.end(), [&](int n) { return n != frame; });
    return other != frames.end() ? *other : frame + 1;
}

/// "scan.####.vdb" for "scan.vdb".
std::string withPlace(const std::string& path)
{
    if (path == "-") return "out.####.vdb";
    std::filesystem::path file(path);
    const std::string extension = file.extension();
    return file.replace_extension(".####" + extension).string();
}

/// The files of two frames of a sequence, which show what moves from frame to frame.
class Places
{
public:
    Places(const Words& words, const CommandLine& line, const NamedFiles& first, int frame)
        : mFirst(first)
    {
        const int other = otherFrame(line.options.frames, frame);
        const CommandLine otherLine = parseCommandLine(wordsOf(words, other));
        // The same verb of the same line: it names its files again.
        const NamedFiles second = namedFiles(*otherLine.verb, otherLine.options).value();
        for (std::size_t n = 0; n < first.outputs.size(); ++n)
            addOutput(first.outputs[n], second.outputs.at(n));
        requireInputs(words, frame, line.verb->movesByItself());
    }

    /// Options of outputs that are one file for all frames.
    const Words& shared() const { return mShared; }

private:
    void addOutput(const Output& output, const Output& ofOther)
    {
        if (output.path.empty() || output.path != ofOther.path) return;
        if (!output.joinsFrames)
            throw UsageError(fmt::format("{} {}: has no place for the frame's number, so that all "
                                         "frames would be written to it. Name {}",
                                         output.option, output.path, withPlace(output.path)));
        mShared.push_back(output.option);
    }

    /// @throws UsageError where frames would all be the same, or standard input is one of theirs.
    void requireInputs(const Words& words, int frame, bool movesByItself) const
    {
        const Words& inputs = mFirst.inputs;
        if (std::find(inputs.begin(), inputs.end(), "-") != inputs.end())
            throw UsageError("-: standard input can be read once, and not for every frame. Name a "
                             "file");
        const auto isOutput = [&](const std::string& word) {
            const auto ends = [&](const Output& output) {
                const std::string& path = output.path;
                return !path.empty() && word.size() >= path.size() &&
                       word.compare(word.size() - path.size(), path.size(), path) == 0;
            };
            return std::any_of(mFirst.outputs.begin(), mFirst.outputs.end(), ends);
        };
        const auto moves = [&](const std::string& word) {
            return hasFrame(word) && !isOutput(frameFile(word, frame));
        };
        if (!movesByItself && std::none_of(words.begin(), words.end(), moves))
            throw UsageError("--frames: no input and no value has a place for the frame's number, "
                             "so that all frames would be the same. Write in.####.vdb, or --turn "
                             "'$F'");
    }

    const NamedFiles& mFirst;
    Words mShared;
};

class Sequence
{
public:
    Sequence(const Words& words, const CommandLine& line, Session& session)
        : mWords(words), mLine(line), mSession(session)
    {
    }

    /// @return the exit status.
    int run()
    {
        for (const int frame : chosenFrames(mLine.options)) mFrames.emplace_back(frame);
        const std::optional<NamedFiles> files = namedFiles(*mLine.verb, mLine.options);
        if (!files) return 0;
        mShared = Places(mWords, mLine, *files, mLine.options.frames.front()).shared();
        if (!mSession.options().report.empty()) mShared.emplace_back("--report");
        mSession.checkFiles({}, {});
        mJobs = int(std::min<std::size_t>(std::size_t(mLine.options.jobs), mFrames.size()));
        makeFrames();
        if (!mSignal) joinFrames();
        report();
        return conclude();
    }

private:
    struct Made {
        explicit Made(int frame) : number(frame) {}
        int number;
        std::vector<Output> outputs{};
        bool skipped = false, ended = false;
        Clock::time_point start{};
        double seconds = 0;
        FrameEnd end{};
    };
    struct Running {
        Running(Made& made, const FrameProcess::Words& words, const sigset_t& signals)
            : frame(made), process(words, signals)
        {
        }
        Made& frame;
        FrameProcess process;
    };

    void makeFrames()
    {
        const sigset_t signals = stopSignals();
        sigprocmask(SIG_BLOCK, &signals, nullptr);
        for (const int signal : {SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_IGN);
        mSignals = signalfd(-1, &signals, SFD_CLOEXEC);
        if (mSignals < 0) throw std::system_error(errno, std::generic_category());
        std::size_t next = 0;
        for (;;) {
            while (!mSignal && int(mRunning.size()) < mJobs && next < mFrames.size())
                start(mFrames[next++], signals);
            if (mRunning.empty()) break;
            hear();
            printInOrder();
        }
        printInOrder();
        mSession.display().clear();
    }

    /// The files that a frame names; none where it names none: its own run says why.
    std::vector<Output> outputsOf(int number) const
    {
        try {
            const CommandLine line = parseCommandLine(wordsOf(mWords, number));
            const std::optional<NamedFiles> files = namedFiles(*line.verb, line.options);
            return files ? files->outputs : std::vector<Output>();
        } catch (const Error&) {
            return {};
        }
    }

    bool isShared(const Output& output) const
    {
        return std::find(mShared.begin(), mShared.end(), output.option) != mShared.end();
    }

    /// Whether all files of @a frame are there, and at least one. An empty one is what is left of
    /// something that failed.
    bool isThere(const Made& frame) const
    {
        int files = 0;
        for (const Output& output : frame.outputs) {
            if (output.path.empty() || isShared(output)) continue;
            std::error_code ignored;
            if (!std::filesystem::exists(output.path, ignored) ||
                std::filesystem::is_empty(output.path, ignored))
                return false;
            ++files;
        }
        return files > 0;
    }

    void start(Made& frame, const sigset_t& signals)
    {
        frame.outputs = outputsOf(frame.number);
        frame.start = Clock::now();
        frame.skipped = mLine.options.skipExisting && isThere(frame);
        if (frame.skipped) {
            frame.ended = true;
            return;
        }
        const auto words = [&](int report) {
            Words task = wordsOf(mWords, frame.number);
            // After the verb, as "--" may end the options.
            task.insert(task.begin() + 2,
                        std::string(kTaskOption) + "=" + taskOf(frame.number, report).dump());
            return task;
        };
        mRunning.emplace_back(frame, words, signals);
    }

    /// What a frame's own process has to know beside its command line.
    Json taskOf(int number, int report) const
    {
        const bool showsProgress = mSession.display().style() != ProgressStyle::None;
        return {{"frame", number},
                {"shared", mShared},
                {"jobs", mJobs},
                {"progress", showsProgress ? "json" : "none"},
                {"report", report}};
    }

    /// Waits until a frame says something or ends, or a signal comes.
    void hear()
    {
        std::vector<pollfd> files{{mSignals, POLLIN, 0}};
        for (const Running& running : mRunning)
            files.push_back({running.process.said(), POLLIN, 0});
        if (poll(files.data(), files.size(), -1) < 0) {
            if (errno == EINTR) return;
            throw std::system_error(errno, std::generic_category());
        }
        if (files.front().revents) passSignalOn();
        std::size_t n = 1;
        for (auto running = mRunning.begin(); running != mRunning.end(); ++n)
            running = files[n].revents && hasEnded(*running) ? mRunning.erase(running)
                                                             : std::next(running);
    }

    /// Takes what a frame says. @return whether its process has ended.
    bool hasEnded(Running& running)
    {
        bool ended = false;
        Made& frame = running.frame;
        for (const std::string& line : running.process.lines(ended)) relay(frame.number, line);
        if (!ended) return false;
        frame.end = running.process.end();
        frame.seconds = std::chrono::duration<double>(Clock::now() - frame.start).count();
        frame.ended = true;
        if (frame.end.report.is_null() && frame.end.status != 0)
            relay(frame.number, frame.end.message); // its process could not say it
        mDone += 1;
        showProgress(fmt::format("frame {}", frame.number));
        return true;
    }

    /// Prints a frame's line, or shows the progress that it tells of.
    void relay(int number, const std::string& line)
    {
        if (line.rfind("{\"stage\":", 0) != 0)
            return mSession.display().print(fmt::format("frame {}: {}", number, line));
        const Json step = Json::parse(line, nullptr, false);
        if (step.is_discarded()) return;
        if (mSession.display().style() == ProgressStyle::JsonLines) {
            Json ofFrame{{"frame", number}};
            ofFrame.update(step);
            mSession.display().print(ofFrame.dump());
        } else {
            showProgress(fmt::format("frame {}: {}", number, step.value("stage", "")));
        }
    }

    void showProgress(const std::string& what)
    {
        if (mSession.display().style() == ProgressStyle::Bar)
            mSession.display().show(what, double(mDone) / double(mFrames.size()));
    }

    /// Frames stop within 250 ms of a signal, and at a second one at once.
    void passSignalOn()
    {
        signalfd_siginfo info{};
        if (read(mSignals, &info, sizeof info) != ssize_t(sizeof info)) return;
        if (!mSignal) mSignal = int(info.ssi_signo);
        for (const Running& running : mRunning) running.process.signal(int(info.ssi_signo));
    }

    /// Prints what frames printed on standard output, as far as all before them have ended.
    void printInOrder()
    {
        for (; mPrinted < mFrames.size() && mFrames[mPrinted].ended; ++mPrinted) {
            printText(mFrames[mPrinted].end.out);
            mFrames[mPrinted].end.out.clear();
        }
    }

    /// Writes the outputs that are one file for all frames, of those whose files are there.
    void joinFrames() const
    {
        const auto& named = mFrames.front().outputs;
        if (std::none_of(named.begin(), named.end(), [&](const Output& o) { return isShared(o); }))
            return;
        std::vector<FrameFiles> there;
        for (const int number : mLine.options.frames) {
            Made frame(number);
            frame.outputs = outputsOf(number);
            if (isThere(frame)) there.push_back({number, frame.outputs});
        }
        if (!there.empty()) mLine.verb->joinFrames(there);
    }

    void report() const
    {
        Json frames = Json::array();
        for (const Made& frame : mFrames) {
            if (!frame.ended) continue; // a signal came before it
            Json entry{{"frame", frame.number}, {"status", frame.end.status}};
            if (frame.skipped) entry["skipped"] = true;
            if (!frame.end.message.empty()) entry["message"] = frame.end.message;
            entry["outputs"] = Json::array();
            for (const Output& output : frame.outputs)
                if (!output.path.empty()) entry["outputs"].push_back(output.path);
            entry["seconds"] = frame.seconds;
            if (!frame.end.report.is_null()) entry["report"] = frame.end.report;
            frames.push_back(entry);
        }
        mSession.report()["frames"] = frames;
    }

    /// Says how it went. @return the exit status.
    int conclude() const
    {
        if (mSignal) {
            mSession.fail("Interrupted", "interrupted");
            return 128 + mSignal;
        }
        int status = 0;
        std::size_t skipped = 0;
        Words failed;
        for (const Made& frame : mFrames) {
            skipped += frame.skipped;
            status = std::max(status, frame.end.status);
            if (frame.end.status != 0)
                failed.push_back(fmt::format("{} (status {})", frame.number, frame.end.status));
        }
        mSession.note(fmt::format("frames      {} made, {} skipped, {} failed",
                                  mFrames.size() - skipped - failed.size(), skipped,
                                  failed.size()));
        if (!failed.empty())
            mSession.fail("FramesFailed", fmt::format("{} of {} frames failed: {}", failed.size(),
                                                      mFrames.size(), fmt::join(failed, ", ")));
        return status;
    }

    const Words& mWords;
    const CommandLine& mLine;
    Session& mSession;
    std::vector<Made> mFrames;
    std::list<Running> mRunning;
    Words mShared; ///< options of outputs that are one file for all frames
    int mJobs = 1;
    int mSignals = -1;        ///< a signalfd
    int mSignal = 0;          ///< that stopped the sequence
    std::size_t mDone = 0;    ///< frames made
    std::size_t mPrinted = 0; ///< frames whose standard output was printed
};

} // namespace

std::vector<std::string> firstFrameOf(const std::vector<std::string>& words)
{
    const std::string option = "--frames", task = std::string(kTaskOption) + "=";
    if (words.size() > 2 && words[2].rfind(task, 0) == 0) return words; // a frame's own process
    for (std::size_t n = 1; n < words.size(); ++n) {
        const bool isNext = words[n] == option && n + 1 < words.size();
        if (!isNext && words[n].rfind(option + "=", 0) != 0) continue;
        try {
            const std::string range = isNext ? words[n + 1] : words[n].substr(option.size() + 1);
            return wordsOf(words, parseFrames(range).front());
        } catch (const UsageError&) {
            return wordsOf(words, 0); // the parser says so, and of nothing else
        }
    }
    return words;
}

int runSequence(const std::vector<std::string>& words, const CommandLine& line)
{
    CommonOptions own = line.options;
    own.threads.reset(); // frames have them, and the limit of memory, which they would inherit
    own.maxBytes = std::uint64_t(1) << 62;
    const int other = otherFrame(own.frames, own.frames.front());
    if (parseCommandLine(wordsOf(words, other)).options.report != own.report)
        own.report.clear(); // each frame has its own
    Session session(line.verb->text().name, own);
    Sequence sequence(words, line, session);
    const int status = guarded(session, [&] { return ExitCode(sequence.run()); });
    const int reported = guarded(session, [&] {
        session.writeReport();
        return ExitCode::Ok;
    });
    return status ? status : reported;
}

int runFrame(const CommandLine& line)
{
    CommonOptions options = line.options;
    int reportFile = -1;
    try {
        const Json task = Json::parse(options.task);
        const int jobs = task.at("jobs");
        options.frame =
            Frame{task.at("frame"), options.frames.at(0), options.frames.back(), task.at("shared")};
        options.progress = task.at("progress");
        options.maxBytes = std::max<std::uint64_t>(1, options.maxBytes / std::uint64_t(jobs));
        if (jobs > 1) options.threads = std::max(1, options.threads.value_or(processors()) / jobs);
        reportFile = task.at("report");
    } catch (const std::exception& e) {
        throw UsageError(fmt::format("{}: is for sequences only: {}", kTaskOption, e.what()));
    }
    std::string report;
    const int status = runVerb(*line.verb, options, &report);
    writeBytes(reportFile, report);
    return status;
}

} // namespace mpuvdb::command
