// Three numbers from Python, called a Vector in signatures and errors.
#pragma once
#include <mpuvdb/vec.h>

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>

#include <algorithm>

namespace pybind11::detail
{

template <>
struct type_caster<mpuvdb::Vec3d> {
    PYBIND11_TYPE_CASTER(mpuvdb::Vec3d, const_name("Vector"));

    bool load(handle source, bool)
    {
        if (!source || source.is_none()) return false;
        const auto numbers = array_t<double, array::forcecast>::ensure(source);
        if (!numbers || numbers.ndim() != 1 || numbers.size() != 3) return false;
        const auto in = numbers.unchecked<1>();
        value = {in(0), in(1), in(2)};
        return true;
    }
    static handle cast(const mpuvdb::Vec3d& v, return_value_policy, handle)
    {
        return array_t<double>(3, v.data()).release();
    }
};

} // namespace pybind11::detail
