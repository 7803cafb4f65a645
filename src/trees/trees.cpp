#include "trees.h"

template class openvdb::tree::Tree<openvdb::FloatTree::RootNodeType>;
template class openvdb::Grid<openvdb::FloatTree>;
template class openvdb::tree::Tree<openvdb::Vec3STree::RootNodeType>;
template class openvdb::Grid<openvdb::Vec3STree>;
template class openvdb::tree::Tree<openvdb::MaskTree::RootNodeType>;
template class openvdb::Grid<openvdb::MaskTree>;
