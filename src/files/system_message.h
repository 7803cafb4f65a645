// What the system says of its errors.
#pragma once
#include <string>
#include <system_error>

namespace mpuvdb
{

/// The system's words for its error number @a error; safe in any thread.
inline std::string systemMessage(int error)
{
    return std::generic_category().message(error);
}

} // namespace mpuvdb
