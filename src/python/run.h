// Long work of the library, called from Python.
#pragma once
#include <mpuvdb/interrupter.h>

#include <pybind11/pybind11.h>

#include <functional>
#include <optional>

namespace mpuvdb::python
{

/// Do @a work on a thread of its own while this one, which holds the interpreter's lock, lets go of
/// it and wakes up fifty times a second: to see to signals, so that Ctrl-C stops the work, and to
/// call @a listener(stage, fraction), unless it is None. The work is stopped if the listener
/// returns False or raises; either is thrown here, after the work has ended. Its notes become
/// UserWarnings.
void runWork(const pybind11::object& listener, const std::function<void(Interrupter&)>& work);

/// End here if the work that runs on this thread is to stop: for long loops of Python functions.
/// @throws Interrupted
void checkWork();

/// The same as runWork(), with a result.
template <class Work>
auto run(const pybind11::object& listener, Work&& work)
{
    std::optional<decltype(work(std::declval<Interrupter&>()))> result;
    runWork(listener, [&](Interrupter& progress) { result.emplace(work(progress)); });
    return std::move(*result);
}

} // namespace mpuvdb::python
