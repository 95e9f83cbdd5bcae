/* numpy's minimum and maximum: what is not a number goes through, of two equal ones the second counts. */
#pragma once
#include <math.h>

static inline double least_of(double a, double b) { return a < b || a != a ? a : b; }
static inline double most_of(double a, double b) { return a > b || a != a ? a : b; }
static inline double clamped(double x, double limit) { return most_of(least_of(x, limit), -limit); }
