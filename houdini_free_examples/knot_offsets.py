#!/usr/bin/python3
"""A knot thinner, as it is, thicker, and so thick that its loops meet: one file, four solids.

Ohtake et al., Multi-level partition of unity implicits, Figure 11.
"""

import mpuvdb as mv
from models import arguments, knot, model, save

args = arguments(__doc__, "knot")
thing = model(args.knot, knot)

# A Shape only describes: nothing is sampled yet, however many solids stand in the row.
row = [
    thing.offset(distance).translate((1.25 * place, 0, 0))
    for place, distance in enumerate((-0.025, 0, 0.025, 0.05))
]
figure = mv.union(*row)

# What each part needs: a band as wide as its offset reaches, and not wider.
print(figure.explain(voxel_size=1 / args.voxels))
save(figure.level_set(1 / args.voxels), args.output, "knot_offsets.vdb")
