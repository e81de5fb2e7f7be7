/* All stages, included once for each instruction set. */
#include "kinematics.h"
#include "linear.h"

#include "assignment.h"
#include "fit.h"
#include "labels.h"
#include "learned.h"
#include "pixels.h"
#include "points.h"
#include "posing.h"
#include "prior.h"
#include "rigid.h"
#include "search.h"
#include "slew.h"

#include "locate.h"

#include "choices.h"
#include "noise.h"
#include "sample.h"

#include "estimate.h"
#include "network.h"

#include "follow.h"
#include "trajectory.h"
