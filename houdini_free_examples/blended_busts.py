#!/usr/bin/python3
"""A head grows out of a rabbit's back, where they meet a fillet, as if cast in one piece.

Ohtake et al., Multi-level partition of unity implicits, Figure 12.
"""

import mpuvdb as mv
from models import arguments, head, model, rabbit, save

args = arguments(__doc__, "rabbit", "head")
body = model(args.rabbit, rabbit)
# Smaller than the rabbit, and reaching into its back.
bust = model(args.head, head).scale(0.6).translate((0.28, 0.25, 0.05))

sharp = body | bust
smooth = mv.blend_union(body, bust, radius=0.08)

for name, shape in (("sharp", sharp), ("smooth", smooth)):
    save(shape.level_set(1 / args.voxels), args.output, f"busts_{name}.vdb")
# A coat of paint all around it, four voxels thick.
coat = smooth.shell(4 / args.voxels, wall="outward")
save(coat.level_set(1 / args.voxels), args.output, "busts_coat.vdb")
