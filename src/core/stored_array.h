// Immutable arrays that are held in memory or lie in a mapped file.
#pragma once
#include <cstddef>
#include <memory>
#include <utility>

namespace mpuvdb
{

/// Elements one after the other, which never change: those of a container that was handed over, or
/// of memory that somebody else keeps, such as a mapped file. Copies share them.
template <typename T>
class StoredArray
{
public:
    StoredArray() = default;
    /// Take over @a from, a vector of elements.
    template <typename Container, typename = decltype(std::declval<Container>().capacity())>
    StoredArray(Container&& from) // NOLINT: implicit, so that arrays are assigned like vectors
    {
        auto owned = std::make_shared<std::decay_t<Container>>(std::forward<Container>(from));
        mData = owned->data();
        mSize = owned->size();
        mBytes = owned->capacity() * sizeof(T);
        mOwner = std::move(owned);
    }
    /// @a size elements at @a data, which live as long as @a owner.
    StoredArray(const T* data, std::size_t size, std::shared_ptr<const void> owner)
        : mData(data), mSize(size), mOwner(std::move(owner))
    {
    }

    const T* data() const { return mData; }
    std::size_t size() const { return mSize; }
    bool empty() const { return mSize == 0; }
    const T& operator[](std::size_t n) const { return mData[n]; }
    const T* begin() const { return mData; }
    const T* end() const { return mData + mSize; }
    /// Memory held, bytes; what is mapped is the system's to keep or to drop.
    std::size_t bytes() const { return mBytes; }

private:
    const T* mData = nullptr;
    std::size_t mSize = 0, mBytes = 0;
    std::shared_ptr<const void> mOwner;
};

} // namespace mpuvdb
