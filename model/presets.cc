#include "model/presets.h"
