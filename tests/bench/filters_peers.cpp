// The problems of filters.rs with Eigen, in the forms in which one writes a filter by hand; prints nanoseconds per step.
//
//   g++ -O3 -march=native -I /usr/include/eigen3 tests/bench/filters_peers.cpp -o filters_peers && ./filters_peers

#include <Eigen/Dense>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <vector>

using namespace Eigen;

template <int R, int C> using Mat = Matrix<double, R, C>;
template <int N> using Vec = Matrix<double, N, 1>;

static double number(int i, int j) { return std::sin(1.0 + 3.7 * i + 1.3 * j); }

template <class T> static void keep(T &value) { asm volatile("" : : "r"(&value) : "memory"); }

template <int N> struct Belief {
  Vec<N> mean;
  Mat<N, N> covariance;
};

template <int N> static Belief<N> belief() {
  Belief<N> b;
  Mat<N, N> root;
  for (int i = 0; i < N; ++i) {
    b.mean[i] = number(i, 0);
    for (int j = 0; j < N; ++j) root(i, j) = number(i, j);
  }
  b.covariance = root * root.transpose() / N + 0.5 * Mat<N, N>::Identity();
  return b;
}

// The fastest of many repeats of many steps, as the other side of the comparison takes it.
template <class Step> static void report(const char *problem, const char *form, Step step) {
  const int steps = 2000, repeats = 300;
  double best = 1e300;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < steps; ++i) step();
    std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    best = std::min(best, seconds.count() / steps);
  }
  std::printf("%s\t%s\t%.1f\n", problem, form, 1e9 * best);
}

template <int N, int M> struct Rows {
  Mat<N, N> transition;
  Vec<M> innovation;
  Mat<M, N> jacobian;
  double noise = 0.2;
};

template <int N, int M> static void joint(Belief<N> &b, const Rows<N, M> &rows, bool joseph) {
  const Mat<N, M> cross = b.covariance * rows.jacobian.transpose();
  const Mat<M, M> s = rows.jacobian * cross + rows.noise * Mat<M, M>::Identity();
  const LLT<Mat<M, M>> factor(s);
  const Mat<N, M> gain = factor.solve(cross.transpose()).transpose();
  b.mean += gain * rows.innovation;
  if (joseph) {
    const Mat<N, N> rest = Mat<N, N>::Identity() - gain * rows.jacobian;
    b.covariance = (rest * b.covariance * rest.transpose() + rows.noise * gain * gain.transpose()).eval();
  } else {
    b.covariance -= gain * cross.transpose();
    b.covariance = (0.5 * (b.covariance + b.covariance.transpose())).eval();
  }
}

template <int N, int M> static void sequential(Belief<N> &b, const Rows<N, M> &rows, bool joseph) {
  Vec<N> change = Vec<N>::Zero();
  for (int row = 0; row < M; ++row) {
    const Vec<N> h = rows.jacobian.row(row).transpose();
    const Vec<N> cross = b.covariance * h;
    const double s = h.dot(cross) + rows.noise;
    const Vec<N> gain = cross / s;
    change += gain * (rows.innovation[row] - h.dot(change));
    if (joseph) {
      // A P = P - k c', then (A P) A' + r k k' with A P h = c - k h'c
      const Vec<N> rest = gain * (rows.noise + h.dot(cross)) - cross;
      b.covariance.noalias() -= gain * cross.transpose();
      b.covariance.noalias() += rest * gain.transpose();
    } else {
      b.covariance.noalias() -= gain * cross.transpose();
    }
  }
  b.mean += change;
}

template <int N, int M> static void ekf(const char *problem) {
  Rows<N, M> rows;
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) rows.transition(i, j) = (i == j) + 0.1 * number(j, i);
  for (int i = 0; i < M; ++i) {
    rows.innovation[i] = 0.3 * number(i, 1);
    for (int j = 0; j < N; ++j) rows.jacobian(i, j) = number(i, j);
  }
  const Belief<N> start = belief<N>();
  auto step = [&](auto update) {
    return [&, update] {
      Belief<N> b = start;
      keep(b);
      keep(rows);
      b.mean = (rows.transition * b.mean).eval();
      const Mat<N, N> half = rows.transition * b.covariance;
      b.covariance.noalias() = half * rows.transition.transpose();
      update(b);
      keep(b);
    };
  };
  report(problem, "joint, Joseph", step([&](auto &b) { joint<N, M>(b, rows, true); }));
  report(problem, "joint, short", step([&](auto &b) { joint<N, M>(b, rows, false); }));
  report(problem, "sequential, Joseph", step([&](auto &b) { sequential<N, M>(b, rows, true); }));
  report(problem, "sequential, short", step([&](auto &b) { sequential<N, M>(b, rows, false); }));
}

template <int N, int M> static void ukf(const char *problem) {
  constexpr int P = 2 * N + 1;
  const double alpha = 0.5, beta = 2.0, square = alpha * alpha * N;
  const double distance = std::sqrt(square), outer = 0.5 / square;
  const double of_mean = (square - N) / square, of_covariance = of_mean + 1.0 - alpha * alpha + beta;
  Vec<M> sample;
  for (int i = 0; i < M; ++i) sample[i] = 0.5 * number(i, 2);
  const Belief<N> start = belief<N>();
  auto predict = [&](Belief<N> &b) {
    const LLT<Mat<N, N>> factor(b.covariance);
    const Mat<N, N> root = distance * Mat<N, N>(factor.matrixL());
    Mat<N, P> points;
    points.col(0) = b.mean;
    points.template middleCols<N>(1) = root.colwise() + b.mean;
    points.template middleCols<N>(1 + N) = (-root).colwise() + b.mean;
    Mat<N, P> moved = points;
    for (int i = 0; i < N; ++i) moved.row(i).array() += 0.05 * points.row((i + 1) % N).array().square();
    Vec<P> weights = Vec<P>::Constant(outer);
    weights[0] = of_mean;
    b.mean.noalias() = moved * weights;
    moved.colwise() -= b.mean;
    weights[0] = of_covariance;
    b.covariance.noalias() = moved * weights.asDiagonal() * moved.transpose();
    b.covariance.diagonal().array() += 0.01;
  };
  auto step = [&](auto update) {
    return [&, update] {
      Belief<N> b = start;
      keep(b);
      keep(sample);
      predict(b);
      update(b);
      keep(b);
    };
  };
  report(problem, "joint", step([&](auto &b) {
           const Mat<N, M> cross = b.covariance.template leftCols<M>();
           const Mat<M, M> s = cross.template topRows<M>() + 0.2 * Mat<M, M>::Identity();
           const LLT<Mat<M, M>> factor(s);
           const Mat<N, M> gain = factor.solve(cross.transpose()).transpose();
           b.mean += gain * (sample - b.mean.template head<M>());
           b.covariance -= gain * cross.transpose();
         }));
  report(problem, "sequential", step([&](auto &b) {
           for (int i = 0; i < M; ++i) {
             const Vec<N> cross = b.covariance.col(i);
             const double inverse = 1.0 / (cross[i] + 0.2);
             b.mean += cross * (inverse * (sample[i] - b.mean[i]));
             b.covariance.noalias() -= (inverse * cross) * cross.transpose();
           }
         }));
}

int main() {
  ekf<6, 6>("ekf_6_6");
  ekf<13, 6>("ekf_13_6");
  ukf<3, 1>("ukf_3_1");
  ukf<4, 3>("ukf_4_3");
}
