#include "model/shape_check.h"
