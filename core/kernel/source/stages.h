/* All stages, included once for each instruction set. */
#include "kinematics.h"
#include "search.h"
