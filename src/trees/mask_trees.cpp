#include "trees.h"

template class openvdb::tree::Tree<openvdb::MaskTree::RootNodeType>;
template class openvdb::Grid<openvdb::MaskTree>;
