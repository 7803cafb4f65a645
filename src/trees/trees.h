// OpenVDB's grids of floats, vectors and masks, compiled once. Their functions are virtual: every
// unit that makes a grid would compile all of them, those that read, write and print it among them.
// Inline ones are still inlined.
#pragma once
#include <openvdb/openvdb.h>

extern template class openvdb::tree::Tree<openvdb::FloatTree::RootNodeType>;
extern template class openvdb::Grid<openvdb::FloatTree>;
extern template class openvdb::tree::Tree<openvdb::Vec3STree::RootNodeType>;
extern template class openvdb::Grid<openvdb::Vec3STree>;
extern template class openvdb::tree::Tree<openvdb::MaskTree::RootNodeType>;
extern template class openvdb::Grid<openvdb::MaskTree>;
