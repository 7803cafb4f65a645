// Interruption of work whose stages are not the caller's.
#pragma once
#include <mpuvdb/interrupter.h>

namespace mpuvdb
{

/// Stops with another interrupter, and reports nothing to it.
class Quiet : public Interrupter
{
public:
    explicit Quiet(Interrupter& other)
        : Interrupter({}, [&other] {
              other.check();
              return false;
          })
    {
    }
};

} // namespace mpuvdb
