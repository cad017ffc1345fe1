// The machine's limit: the servo loop of servo.py with the time loop inside and the candidates in the vector lanes.
#include <cmath>
#include <cstdint>
#include <cstring>
#if defined(__SSE2__)
#include <immintrin.h>
#endif

namespace {

// Subnormal numbers are flushed to zero within a call, as XLA does, and only there.
struct Flushed {
#if defined(__SSE2__)
  const unsigned before = _mm_getcsr();
  Flushed() { _mm_setcsr(before | 0x8040u); }  // FTZ and DAZ
  ~Flushed() { _mm_setcsr(before); }
#else
  Flushed() {}
#endif
};

// exp by range reduction and a polynomial: inline, so that the compiler vectorizes the loop that holds it.
inline double exponential(double x) {
  const double n = std::rint(x * 1.4426950408889634);
  const double r = std::fma(n, -1.9082149292705877e-10, std::fma(n, -0.693147180369123816490, x));
  double p = 1.6059043836821613e-10;
  p = std::fma(p, r, 2.08767569878681e-09);
  p = std::fma(p, r, 2.505210838544172e-08);
  p = std::fma(p, r, 2.755731922398589e-07);
  p = std::fma(p, r, 2.7557319223985893e-06);
  p = std::fma(p, r, 2.48015873015873e-05);
  p = std::fma(p, r, 1.984126984126984e-04);
  p = std::fma(p, r, 1.388888888888889e-03);
  p = std::fma(p, r, 8.333333333333333e-03);
  p = std::fma(p, r, 4.1666666666666664e-02);
  p = std::fma(p, r, 1.6666666666666666e-01);
  p = std::fma(p, r, 0.5);
  p = std::fma(p, r, 1.0);
  p = std::fma(p, r, 1.0);
  const int64_t bits = (static_cast<int64_t>(n) + 1023) << 52;
  double scale;
  std::memcpy(&scale, &bits, sizeof scale);
  return p * scale;
}

inline double hyperbolic_tangent(double x) {
  const double y = std::fmin(std::fmax(x, -19.0), 19.0);
  return 1.0 - 2.0 / (exponential(2.0 * y) + 1.0);
}

// In single precision the rational approximation that Eigen and XLA use is the shortest.
inline float hyperbolic_tangent(float x) {
  const float y = std::fmin(std::fmax(x, -7.90531110763549805f), 7.90531110763549805f);
  const float s = y * y;
  float p = -2.76076847742355e-16f;
  p = std::fma(p, s, 2.00018790482477e-13f);
  p = std::fma(p, s, -8.60467152213735e-11f);
  p = std::fma(p, s, 5.12229709037114e-08f);
  p = std::fma(p, s, 1.48572235717979e-05f);
  p = std::fma(p, s, 6.37261928875436e-04f);
  p = std::fma(p, s, 4.89352455891786e-03f);
  float q = 1.19825839466702e-06f;
  q = std::fma(q, s, 1.18534705686654e-04f);
  q = std::fma(q, s, 2.26843463243900e-03f);
  q = std::fma(q, s, 4.89352518554385e-03f);
  return y * p / q;
}

// The compiler's own tanh leaves early where it saturates: faster for few candidates, slower for many.
struct Inline {
  template <typename T> static T tanh(T x) { return hyperbolic_tangent(x); }
};
struct Library {
  template <typename T> static T tanh(T x) { return std::tanh(x); }
};

template <typename T, int W, typename Math>
void chunk(int64_t steps, const T *reference, const T *values, int64_t stride, T dt, T *cost) {
  const T *gain_1 = values, *gain_2 = values + stride, *kp = values + 2 * stride, *ki = values + 3 * stride;
  const T *coulomb = values + 4 * stride, *viscous = values + 5 * stride, *steepness = values + 6 * stride;
  const T *inertia = values + 7 * stride, *model = values + 8 * stride, *velocity = values + 9 * stride;
  T w[W], q[W], z1[W], z2[W], total[W], by_inertia[W], by_model_1[W], by_model_2[W], dt_ki[W];
  for (int i = 0; i < W; ++i) {
    w[i] = velocity[i], q[i] = z1[i] = z2[i] = total[i] = T(0);
    by_inertia[i] = dt / inertia[i], dt_ki[i] = dt * ki[i];
    by_model_1[i] = dt / model[i] * gain_1[i], by_model_2[i] = dt / model[i] * gain_2[i];
  }
  for (int64_t t = 0; t < steps; ++t) {
    const T r = reference[t];
#pragma omp simd
    for (int i = 0; i < W; ++i) {
      const T error = r - w[i], control = kp[i] * error + q[i];
      const T side = w[i] > T(0) ? T(1) : (w[i] < T(0) ? T(-1) : T(0));
      const T compensation =
          (z1[i] - gain_2[i] * std::fabs(w[i])) * side + (z2[i] - T(0.5) * gain_1[i] * w[i] * w[i]) * w[i];
      const T friction = coulomb[i] * Math::tanh(steepness[i] * w[i]) + viscous[i] * w[i];
      z1[i] += by_model_2[i] * side * control;
      z2[i] += by_model_1[i] * w[i] * control;
      w[i] += by_inertia[i] * (control + compensation - friction);
      q[i] += dt_ki[i] * error;
      total[i] += error * error;
    }
  }
  for (int i = 0; i < W; ++i) cost[i] = total[i] / T(steps);
}

template <typename T, int W, typename Math>
int chunks(int64_t size, int64_t steps, const T *reference, const T *values, T dt, T *cost) {
  for (int64_t i = 0; i < size / W; ++i) chunk<T, W, Math>(steps, reference, values + i * W, size, dt, cost + i * W);
  return 0;
}

template <typename T, typename Math>
int run(int64_t width, int64_t size, int64_t steps, const T *reference, const T *values, T dt, T *cost) {
  if (size % width) return 1;
  switch (width) {
    case 1: return chunks<T, 1, Math>(size, steps, reference, values, dt, cost);
    case 2: return chunks<T, 2, Math>(size, steps, reference, values, dt, cost);
    case 4: return chunks<T, 4, Math>(size, steps, reference, values, dt, cost);
    case 5: return chunks<T, 5, Math>(size, steps, reference, values, dt, cost);
    case 8: return chunks<T, 8, Math>(size, steps, reference, values, dt, cost);
    case 16: return chunks<T, 16, Math>(size, steps, reference, values, dt, cost);
    case 32: return chunks<T, 32, Math>(size, steps, reference, values, dt, cost);
    case 64: return chunks<T, 64, Math>(size, steps, reference, values, dt, cost);
  }
  return 2;
}

}  // namespace

extern "C" int run_float64(int64_t library, int64_t width, int64_t size, int64_t steps, const double *reference,
                           const double *values, double dt, double *cost) {
  const Flushed flushed;
  return library ? run<double, Library>(width, size, steps, reference, values, dt, cost)
                 : run<double, Inline>(width, size, steps, reference, values, dt, cost);
}

extern "C" int run_float32(int64_t library, int64_t width, int64_t size, int64_t steps, const float *reference,
                           const float *values, float dt, float *cost) {
  const Flushed flushed;
  return library ? run<float, Library>(width, size, steps, reference, values, dt, cost)
                 : run<float, Inline>(width, size, steps, reference, values, dt, cost);
}
