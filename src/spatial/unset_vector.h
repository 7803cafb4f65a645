// The arrays that fits work on.
#pragma once
#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>

namespace mpuvdb
{

/// Numbers one after the other: new ones are unset, and the size is changed at no cost up to the
/// capacity.
template <typename T>
class UnsetVector
{
public:
    UnsetVector() = default;
    UnsetVector(const UnsetVector& other) { *this = other; }
    UnsetVector(UnsetVector&& other) noexcept { swap(other); }
    UnsetVector& operator=(const UnsetVector& other)
    {
        if (this == &other) return *this;
        resize(other.mSize);
        std::copy(other.begin(), other.end(), begin());
        return *this;
    }
    UnsetVector& operator=(UnsetVector&& other) noexcept
    {
        UnsetVector(std::move(other)).swap(*this);
        return *this;
    }

    std::size_t size() const { return mSize; }
    std::size_t capacity() const { return mCapacity; }
    T* data() { return mData.get(); }
    const T* data() const { return mData.get(); }
    T& operator[](std::size_t i) { return mData[i]; }
    const T& operator[](std::size_t i) const { return mData[i]; }
    T* begin() { return data(); }
    T* end() { return data() + mSize; }
    const T* begin() const { return data(); }
    const T* end() const { return data() + mSize; }
    void clear() { mSize = 0; }
    void assign(std::size_t n, const T& value)
    {
        resize(n);
        std::fill(begin(), end(), value);
    }
    void resize(std::size_t n)
    {
        if (n > mCapacity) grow(n);
        mSize = n;
    }

private:
    void swap(UnsetVector& other) noexcept
    {
        std::swap(mData, other.mData);
        std::swap(mSize, other.mSize);
        std::swap(mCapacity, other.mCapacity);
    }
    void grow(std::size_t n)
    {
        mCapacity = std::max(n, 2 * mCapacity);
        std::unique_ptr<T[]> larger(new T[mCapacity]);
        std::copy(begin(), end(), larger.get());
        mData = std::move(larger);
    }

    std::unique_ptr<T[]> mData;
    std::size_t mSize = 0, mCapacity = 0;
};

} // namespace mpuvdb
