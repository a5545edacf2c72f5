/* Information blocks of a unicycle in constant wind, written by hand: what generated code is measured against.

   States x, y, heading, wind_x, wind_y; inputs speed, turn_rate, held over each step of dt seconds (RK4).
   Sensors: GPS, magnetometer, range and bearing to one beacon. Block [k, s] = Phi_k' C_sk' R_s^-1 C_sk Phi_k,
   Phi_(k+1) = F_k Phi_k, Phi_0 = I, F_k the derivative of the RK4 step at x[k], u[k].

   Phi is the identity but for four entries: a = Phi[0,2], b = Phi[1,2], and Phi[0,3] = Phi[1,4] = t. The heading is linear in
   time over a step, so that RK4's two middle stages share one sine and one cosine. */
#define _GNU_SOURCE
#include <math.h>
#include <string.h>

typedef struct {
  double dt, beacon_x, beacon_y, gps, magnetometer, range, bearing; /* the last four: standard deviations */
} Setting;

/* W = c c': 15 products, 25 entries */
static inline void outer(double *restrict W, double c0, double c1, double c2, double c3, double c4) {
  W[0] = c0 * c0;
  W[6] = c1 * c1;
  W[12] = c2 * c2;
  W[18] = c3 * c3;
  W[24] = c4 * c4;
  W[1] = W[5] = c0 * c1;
  W[2] = W[10] = c0 * c2;
  W[3] = W[15] = c0 * c3;
  W[4] = W[20] = c0 * c4;
  W[7] = W[11] = c1 * c2;
  W[8] = W[16] = c1 * c3;
  W[9] = W[21] = c1 * c4;
  W[13] = W[17] = c2 * c3;
  W[14] = W[22] = c2 * c4;
  W[19] = W[23] = c3 * c4;
}

static inline void gps_block(double *restrict W, double a, double b, double t, double weight) {
  const double wa = weight * a, wb = weight * b, wt = weight * t;
  W[0] = W[6] = weight;
  W[2] = W[10] = wa;
  W[7] = W[11] = wb;
  W[12] = wa * a + wb * b;
  W[3] = W[15] = W[9] = W[21] = wt;
  W[13] = W[17] = wa * t;
  W[14] = W[22] = wb * t;
  W[18] = W[24] = wt * t;
  W[1] = W[4] = W[5] = W[8] = W[16] = W[19] = W[20] = W[23] = 0;
}

/* the four blocks of one sample; at: with 1 / sigma for the range and the bearing, 1 / sigma^2 for the other two */
static inline void sensors(double *restrict W, double x, double y, double a, double b, double t, const Setting *at) {
  const double east = at->beacon_x - x, north = at->beacon_y - y, square = east * east + north * north;
  const double per_range = at->range / sqrt(square), per_bearing = at->bearing / square;
  const double p = -east * per_range, q = -north * per_range, r = north * per_bearing, s = -east * per_bearing;
  gps_block(W, a, b, t, at->gps);
  memset(W + 25, 0, 25 * sizeof(double));
  W[25 + 12] = at->magnetometer;
  outer(W + 50, p, q, p * a + q * b, p * t, q * t);
  outer(W + 75, r, s, r * a + s * b - at->bearing, r * t, s * t);
}

static inline Setting inverted(const Setting *given) {
  Setting at = *given;
  at.gps = 1 / (given->gps * given->gps);
  at.magnetometer = 1 / (given->magnetometer * given->magnetometer);
  at.range = 1 / given->range;
  at.bearing = 1 / given->bearing;
  return at;
}

/* x (steps, 5), u (steps, 2) -> W (steps, 4, 5, 5) */
void unicycle_wind(long steps, const double *restrict x, const double *restrict u, const Setting *setting, double *restrict W) {
  const Setting at = inverted(setting);
  double a = 0, b = 0, t = 0;
  for (long k = 0; k < steps; ++k, x += 5, u += 2, W += 100) {
    const double turned = u[1] * at.dt, sixth = u[0] * at.dt / 6;
    double s0, c0, s1, c1, s2, c2;
    sincos(x[2], &s0, &c0);
    sincos(x[2] + turned / 2, &s1, &c1);
    sincos(x[2] + turned, &s2, &c2);
    sensors(W, x[0], x[1], a, b, t, &at);
    a -= sixth * (s0 + 4 * s1 + s2);
    b += sixth * (c0 + 4 * c1 + c2);
    t += at.dt;
  }
}

/* the same with s0 + s2 = 2 s1 cos(turned / 2), which no tool finds in an expression: one sine and two cosines per step */
void unicycle_wind_short(long steps, const double *restrict x, const double *restrict u, const Setting *setting, double *restrict W) {
  const Setting at = inverted(setting);
  double a = 0, b = 0, t = 0;
  for (long k = 0; k < steps; ++k, x += 5, u += 2, W += 100) {
    const double half = u[1] * at.dt / 2, mean = u[0] * at.dt / 6 * (4 + 2 * cos(half));
    double s, c;
    sincos(x[2] + half, &s, &c);
    sensors(W, x[0], x[1], a, b, t, &at);
    a -= mean * s;
    b += mean * c;
    t += at.dt;
  }
}
