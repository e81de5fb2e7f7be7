/* All stages, included once for each instruction set. */
#include "kinematics.h"

#include "gaussian.h"
#include "rigid.h"
#include "search.h"
