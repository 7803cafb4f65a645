#include "io_fixture.h"

namespace mpuvdb::test
{
namespace
{

const float kCorners[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
const std::int32_t kFaces[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};

std::string plyBinary(bool big)
{
    std::string s = concat("ply\nformat binary_", big ? "big" : "little",
                           "_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
                           "property float z\nelement face 4\n"
                           "property list uchar int vertex_indices\nend_header\n");
    for (const auto& p : kCorners)
        for (const float c : p) s += bytesOf(c, big);
    for (const auto& f : kFaces) {
        s += char(3);
        for (const std::int32_t i : f) s += bytesOf(i, big);
    }
    return s;
}

std::string stlBinary()
{
    std::string s(80, ' ');
    s += bytesOf(std::uint32_t(4));
    for (const auto& f : kFaces) {
        for (int i = 0; i < 3; ++i) s += bytesOf(0.f);
        for (const std::int32_t i : f)
            for (const float c : kCorners[i]) s += bytesOf(c);
        s += bytesOf(std::uint16_t(0));
    }
    return s;
}

std::string stlText()
{
    std::string s = "solid t\n";
    for (const auto& f : kFaces) {
        s += "facet normal 0 0 0\nouter loop\n";
        for (const std::int32_t i : f)
            s += concat("vertex ", std::to_string(kCorners[i][0]), " ",
                        std::to_string(kCorners[i][1]), " ", std::to_string(kCorners[i][2]), "\n");
        s += "endloop\nendfacet\n";
    }
    return s + "endsolid t\n";
}

std::string pcdHeader(const std::string& data)
{
    return "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
           "WIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA " +
           data + "\n";
}

std::string pcdBinary(bool compressed)
{
    std::string data;
    const std::uint32_t rgb = 0x0a141e;
    if (!compressed) {
        for (const auto& p : kCorners) {
            for (const float c : p) data += bytesOf(c);
            data += bytesOf(rgb);
        }
        return pcdHeader("binary") + data;
    }
    for (int c = 0; c < 3; ++c)
        for (const auto& p : kCorners) data += bytesOf(p[c]);
    for (int i = 0; i < 4; ++i) data += bytesOf(rgb);
    std::string packed; // literal runs of 16, then the last 12 bytes as a copy of those 4 back
    for (int i = 0; i < 3; ++i) packed += concat(std::string(1, 15), data.substr(16 * i, 16));
    packed += concat(std::string(1, 3), data.substr(48, 4), std::string("\xe0\x03\x03", 3));
    return concat(pcdHeader("binary_compressed"), bytesOf(std::uint32_t(packed.size())),
                  bytesOf(std::uint32_t(data.size())), packed);
}

std::string las(int minor, int format)
{
    const std::size_t size = minor >= 4 ? 375 : 227;
    const std::uint16_t stride = format == 0 ? 20 : format == 2 ? 26 : 36;
    std::string s(size, '\0');
    const auto set = [&](std::size_t at, const std::string& bytes) {
        s.replace(at, bytes.size(), bytes);
    };
    set(0, "LASF");
    s[24] = 1;
    s[25] = char(minor);
    set(94, bytesOf(std::uint16_t(size)));
    set(96, bytesOf(std::uint32_t(size)));
    s[104] = char(format);
    set(105, bytesOf(stride));
    set(107, bytesOf(std::uint32_t(minor >= 4 ? 0 : 4)));
    for (int a = 0; a < 3; ++a) {
        set(131 + 8 * a, bytesOf(0.01));
        set(155 + 8 * a, bytesOf(5000000.0));
    }
    if (minor >= 4) set(247, bytesOf(std::uint64_t(4)));
    for (const auto& p : kCorners) {
        std::string record(stride, '\0');
        for (int a = 0; a < 3; ++a) record.replace(4 * a, 4, bytesOf(std::int32_t(100 * p[a])));
        const std::size_t colors = format == 2 ? 20 : 30;
        if (format != 0)
            for (int c = 0; c < 3; ++c)
                record.replace(colors + 2 * c, 2, bytesOf(std::uint16_t(256 * 10 * (c + 1))));
        s += record;
    }
    return s;
}

std::string ptx()
{
    std::string s = "3\n3\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n100 0 0 1\n";
    for (int c = -1; c <= 1; ++c)
        for (int r = -1; r <= 1; ++r)
            s += concat(std::to_string(c), " ", std::to_string(r), " -5 0.5 10 20 30\n");
    return s;
}

std::string rangeGrid()
{
    std::string s = "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 3\n"
                    "element vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
                    "element range_grid 9\nproperty list uchar int vertex_indices\nend_header\n";
    for (int i = 0; i < 8; ++i)
        s += concat(std::to_string(i % 3), " ", std::to_string(i / 3), " 0\n");
    for (int i = 0; i < 8; ++i) s += concat("1 ", std::to_string(i), "\n");
    return s + "0\n";
}

} // namespace

std::vector<Sample> samples()
{
    const std::string corners = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n",
                      faces = "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    const std::string plyHead = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"
                                "property float y\nproperty float z\n";
    return {
        {"ascii.ply",
         plyHead + "element face 4\nproperty list uchar int vertex_index\nend_header\n" + corners +
             faces,
         4},
        {"little.ply", plyBinary(false), 4},
        {"big.ply", plyBinary(true), 4},
        {"strips.ply",
         plyHead + "element tristrips 1\nproperty list int int vertex_indices\nend_header\n" +
             corners + "7 0 2 1 3 -1 0 3\n",
         4},
        {"grid.ply", rangeGrid(), 8},
        {"columns.xyz", corners, 4},
        {"normals.xyz", "0 0 0 0 0 1\n1 0 0 1 0 0\n0 1 0 0 0.6 0.8\n0 0 1 0 0 -1\n", 4},
        {"counted.pts",
         "4\n"
         "0 0 0 -500 10 20 30\n1 0 0 -400 10 20 30\n0 1 0 7 10 20 30\n0 0 1 9 10 20 30\n",
         4},
        {"classic.pwn", "2\n0 0 0\n1 0 0\n0 0 1\n0 1 0\n", 2},
        {"tagged.pts", "# made by\nd 1 1 1\ns 1 1 1\np 0 0 0\np 1 0 0\np 0 1 0\n", 3},
        {"named.csv", "x,y,z,nx,ny,nz,red,green,blue\n0,0,0,0,0,1,10,20,30\n1,0,0,0,0,1,10,20,30\n",
         2},
        {"rays.ptx", ptx(), 9},
        {"mesh.obj",
         "# c\no t\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1 3 2\nf 1//1 2//1 4//1\nf "
         "-4/1/1 -1/1/1 -2/1/1\nf 2 3 4\n",
         4},
        {"mesh.off", "OFF\n# c\n4 4 0\n" + corners + faces, 4},
        {"normals.off", "NOFF\n2 0 0\n0 0 0 0 0 1\n1 0 0 0 1 0\n", 2},
        {"binary.stl", stlBinary(), 4},
        {"text.stl", stlText(), 4},
        {"ascii.pcd",
         pcdHeader("ascii") + "0 0 0 660510\n1 0 0 660510\n0 1 0 660510\n0 0 1 660510\n", 4},
        {"binary.pcd", pcdBinary(false), 4},
        {"packed.pcd", pcdBinary(true), 4},
        {"plain.las", las(2, 0), 4},
        {"color.las", las(3, 2), 4},
        {"new.las", las(4, 7), 4},
    };
}

} // namespace mpuvdb::test
