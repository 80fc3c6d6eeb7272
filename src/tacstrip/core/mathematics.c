/* exp, tanh, arctan, sin, cos and log to about one unit in the last place, the same on every platform. */

#include "internal.h"

/* x = k ln 2 + r, |r| <= ln 2 / 2; e^r by its series, from r^13 / 13! down. */
double exponential(double x) {
  static const double series[] = {
      1.6059043836821613e-10, 2.08767569878681e-09,   2.505210838544172e-08, 2.755731922398589e-07, 2.7557319223985893e-06,
      2.48015873015873e-05,   0.0001984126984126984,  0.001388888888888889,  0.008333333333333333,  0.041666666666666664,
      0.16666666666666666,    0.5,                    1.0,                   1.0};
  Int k = (Int)(x * 1.44269504088896338700 + (x < 0.0 ? -0.5 : 0.5));
  double r = (x - (double)k * LN2_HIGH) - (double)k * LN2_LOW, sum = 0.0;
  Word power;
  for (int i = 0; i < 14; i++) sum = sum * r + series[i];
  power.bits = (k + 1023) << 52;
  return sum * power.value;
}

double hyperbolic_tangent(double x) {
  double a = x < 0.0 ? -x : x, value;
  if (!(a < 20.0)) value = 1.0;
  else if (a < 0.3) { /* Lambert's continued fraction */
    double z = a * a, below = 13.0;
    for (int i = 11; i > 0; i -= 2) below = (double)i + z / below;
    value = a / below;
  } else value = 1.0 - 2.0 / (exponential(2.0 * a) + 1.0);
  return x < 0.0 ? -value : value;
}

/* By arctan x = pi/2 - arctan 1/x, then half the angle twice. */
double arctangent(double x) {
  double t = x > 1.0 ? 1.0 / x : x, sum = 0.0;
  for (int i = 0; i < 2; i++) t = t / (1.0 + sqrt(1.0 + t * t));
  for (int i = 25; i > 0; i -= 2) sum = 1.0 / (double)i - sum * t * t;
  sum *= 4.0 * t;
  return x > 1.0 ? 1.5707963267948966 - sum : sum;
}

/* x = k pi / 2 + r, |r| <= pi / 4; the series of sin r or cos r by k. */
static double circular(double x, Int quarter) {
  static const double high = 1.57079632673412561417, low = 6.07710050650619224932e-11;
  Int k = (Int)(x * 0.63661977236758134308 + (x < 0.0 ? -0.5 : 0.5)), which = (k + quarter) & 3;
  double r = (x - (double)k * high) - (double)k * low, z = r * r, sum = 1.0;
  for (int i = which & 1 ? 16 : 17; i > 1; i -= 2) sum = 1.0 - sum * z / (double)(i * (i - 1));
  if (!(which & 1)) sum *= r;
  return which & 2 ? -sum : sum;
}

double sine(double x) { return circular(x, 0); }
double cosine(double x) { return circular(x, 1); }
