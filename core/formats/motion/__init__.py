"""Motion files: BVH, ASF/AMC, CSV, VRMA."""
