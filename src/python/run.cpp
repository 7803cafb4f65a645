#include "run.h"

#include <mpuvdb/error.h>

#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

constexpr std::chrono::milliseconds kNap{20};

/// Of the work that runs on this thread.
thread_local const Interrupter* tProgress = nullptr;

struct Report {
    std::string stage;
    double fraction = 0;
};

/// Where the work leaves its reports for the thread that waits.
class Desk
{
public:
    /// Newer fractions of a stage stand for older ones that nobody has fetched.
    void report(const std::string& stage, double fraction)
    {
        std::lock_guard<std::mutex> lock(mMutex);
        const bool known = !mReports.empty() && mReports.back().stage == stage;
        if (known && mReports.back().fraction <= fraction && fraction > 0)
            mReports.back().fraction = fraction;
        else
            mReports.push_back({stage, fraction});
    }
    void finish()
    {
        std::lock_guard<std::mutex> lock(mMutex);
        mFinished = true;
        mWakeUp.notify_one();
    }
    /// The reports of the next nap. @return whether the work has ended.
    bool wait(std::vector<Report>& reports)
    {
        std::unique_lock<std::mutex> lock(mMutex);
        mWakeUp.wait_for(lock, kNap, [this] { return mFinished; });
        reports.clear();
        reports.swap(mReports);
        return mFinished;
    }

private:
    std::mutex mMutex;
    std::condition_variable mWakeUp;
    std::vector<Report> mReports;
    bool mFinished = false;
};

/// False, of Python or of numpy.
bool isFalse(const py::object& value)
{
    if (value.is_none() || PyBool_Check(value.ptr())) return value.is(py::bool_(false));
    return py::isinstance(value, py::module_::import("numpy").attr("bool_")) &&
           PyObject_IsTrue(value.ptr()) == 0;
}

/// Let Python see to signals, and hear the reports. @throws what they raise, Interrupted.
void attend(const py::object& listener, const std::vector<Report>& reports)
{
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    if (listener.is_none()) return;
    for (const Report& report : reports)
        if (isFalse(listener(report.stage, report.fraction))) throw Interrupted();
}

} // namespace

void checkWork()
{
    if (tProgress) tProgress->check();
}

void runWork(const py::object& listener, const std::function<void(Interrupter&)>& work)
{
    if (!listener.is_none() && !PyCallable_Check(listener.ptr()))
        throw py::type_error("progress: must be callable with (stage, fraction), or None");
    Desk desk;
    Interrupter::Listener hear;
    if (!listener.is_none())
        hear = [&](const std::string& stage, double fraction) { desk.report(stage, fraction); };
    Interrupter progress(hear);
    std::exception_ptr failed, stopped;
    std::thread worker([&] {
        tProgress = &progress;
        try {
            work(progress);
            progress.endStage();
        } catch (...) {
            failed = std::current_exception();
        }
        desk.finish();
    });
    for (bool finished = false; !finished;) {
        std::vector<Report> reports;
        {
            const py::gil_scoped_release release;
            finished = desk.wait(reports);
            if (finished) worker.join();
        }
        if (stopped) continue;
        try {
            attend(listener, reports);
        } catch (...) {
            stopped = std::current_exception();
            progress.stop();
        }
    }
    if (stopped) std::rethrow_exception(stopped);
    if (failed) std::rethrow_exception(failed);
    for (const std::string& note : progress.notes())
        if (PyErr_WarnEx(PyExc_UserWarning, note.c_str(), 1) != 0) throw py::error_already_set();
}

} // namespace mpuvdb::python
