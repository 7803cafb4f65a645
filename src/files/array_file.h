// Files of named arrays, which are mapped: what is larger than memory is read where it is used.
#pragma once
#include "core/stored_array.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

namespace mpuvdb
{

/// Writes a file of arrays. Nothing is readable before finish().
class ArrayFileWriter
{
public:
    /// @throws IoError.
    explicit ArrayFileWriter(const std::filesystem::path& file);
    ArrayFileWriter(const ArrayFileWriter&) = delete;
    ArrayFileWriter& operator=(const ArrayFileWriter&) = delete;
    ~ArrayFileWriter();

    /// Write @a array, a vector or StoredArray, under @a name (up to 31 characters).
    /// @throws IoError.
    template <typename Container>
    void add(const std::string& name, const Container& array)
    {
        using T = std::decay_t<decltype(array[0])>;
        write(reserve<T>(name, array.size()), 0, array.data(), array.size());
    }
    /// Write one value under @a name.
    template <typename T>
    void addValue(const std::string& name, const T& value)
    {
        write(reserve<T>(name, 1), 0, &value, 1);
    }
    /// Set aside @a count elements under @a name, and return the number of the array: all of them
    /// have to be written, in any order.
    template <typename T>
    std::size_t reserve(const std::string& name, std::size_t count)
    {
        static_assert(std::is_trivially_destructible_v<T> && std::is_standard_layout_v<T>,
                      "arrays are stored as their bytes");
        return reserveBytes(name, count, sizeof(T));
    }
    /// Write elements of the array @a number from its element @a first on. Several threads may.
    template <typename T>
    void write(std::size_t number, std::size_t first, const T* data, std::size_t count)
    {
        writeBytes(number, first * sizeof(T), data, count * sizeof(T));
    }
    /// Write the directory, and close the file. @throws IoError.
    void finish();

private:
    friend class ArrayFile;
    struct Entry;
    std::size_t reserveBytes(const std::string& name, std::size_t count, std::size_t size);
    void writeBytes(std::size_t number, std::uint64_t from, const void* data, std::size_t bytes);
    void writeAt(std::uint64_t offset, const void* data, std::size_t bytes);

    std::filesystem::path mFile;
    int mDescriptor = -1;
    std::vector<Entry> mEntries;
    std::uint64_t mEnd;
};

/// A file of arrays, mapped.
class ArrayFile
{
public:
    /// Only the directory is read. @throws IoError (cannot be opened), InputError (not such a file,
    /// truncated, of another version).
    explicit ArrayFile(const std::filesystem::path& file);

    bool has(const std::string& name) const { return mEntries.count(name) > 0; }
    /// The array @a name, mapped. @throws InputError if there is none of such elements.
    template <typename T>
    StoredArray<T> get(const std::string& name) const
    {
        static_assert(std::is_trivially_destructible_v<T> && std::is_standard_layout_v<T>,
                      "arrays are stored as their bytes");
        const Part part = find(name, sizeof(T));
        return {static_cast<const T*>(part.data), part.count, mMapping};
    }
    /// The one value @a name. @throws InputError.
    template <typename T>
    T value(const std::string& name) const
    {
        const StoredArray<T> array = get<T>(name);
        if (array.size() != 1) damaged(name);
        return array[0];
    }

private:
    struct Part {
        const void* data;
        std::size_t count, size;
    };
    struct Mapping;
    Part find(const std::string& name, std::size_t size) const;
    [[noreturn]] void damaged(const std::string& what) const;

    std::filesystem::path mFile;
    std::shared_ptr<const Mapping> mMapping;
    std::map<std::string, Part> mEntries;
};

} // namespace mpuvdb
