// The same block adjusted by Ceres Solver, with analytic or automatic derivatives, and its covariances.
//
//   adjust FILE analytic|automatic sparse|dense|dense-lapack THREADS [covariance|default-radius]
//
// Rotations are omega, phi, kappa. With analytic derivatives the rotation matrices and what turns small rotations into
// these angles are worked out once per image and evaluation, by an EvaluationCallback. The solution that is timed ends
// at Ceres' own tolerances; a second one, not timed, goes on to round-off, so that the objective can be compared.
// Prints one JSON object; times in seconds.

#include <ceres/ceres.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace {

struct Block {
  int64_t images, points, rays;
  double sigma_image, sigma_centre;
  std::vector<double> pose;  // centre, omega phi kappa
  std::vector<double> interior, point, observed_centre, xy;
  std::vector<int64_t> image, of_point;
};

template <typename T>
void read(std::FILE* file, std::vector<T>& into, size_t count) {
  into.resize(count);
  if (std::fread(into.data(), sizeof(T), count, file) != count) std::exit(2);
}

Block read_block(const char* name) {
  Block b;
  std::FILE* file = std::fopen(name, "rb");
  if (!file) std::exit(2);
  std::vector<int64_t> counts;
  std::vector<double> sigmas;
  read(file, counts, 3);
  read(file, sigmas, 2);
  b.images = counts[0], b.points = counts[1], b.rays = counts[2];
  b.sigma_image = sigmas[0], b.sigma_centre = sigmas[1];
  read(file, b.pose, 6 * b.images);
  read(file, b.interior, 10);
  read(file, b.point, 3 * b.points);
  read(file, b.observed_centre, 3 * b.images);
  read(file, b.xy, 2 * b.rays);
  read(file, b.image, b.rays);
  read(file, b.of_point, b.rays);
  std::fclose(file);
  return b;
}

template <typename T>
void rotation(const T* angles, T* D) {
  using std::cos, std::sin;
  const T so = sin(angles[0]), co = cos(angles[0]), sp = sin(angles[1]), cp = cos(angles[1]);
  const T sk = sin(angles[2]), ck = cos(angles[2]);
  D[0] = cp * ck, D[1] = co * sk + so * sp * ck, D[2] = so * sk - co * sp * ck;
  D[3] = -cp * sk, D[4] = co * ck - so * sp * sk, D[5] = so * ck + co * sp * sk;
  D[6] = sp, D[7] = -so * cp, D[8] = co * cp;
}

template <typename T>
struct Image {
  T x, y;
};

template <typename T>
Image<T> project(const T* q, const T* i) {
  const T x = -i[0] * q[0] / q[2], y = -i[0] * q[1] / q[2];
  const T r2 = x * x + y * y;
  const T radial = r2 * (i[3] + r2 * (i[4] + r2 * i[5]));
  return {i[1] + x + x * radial + i[6] * (r2 + 2.0 * x * x) + 2.0 * i[7] * x * y + i[8] * x + i[9] * y,
          i[2] + y + y * radial + i[7] * (r2 + 2.0 * y * y) + 2.0 * i[6] * x * y};
}

struct Automatic {
  double x, y, weight;
  template <typename T>
  bool operator()(const T* pose, const T* interior, const T* point, T* residual) const {
    T D[9], q[3];
    rotation(pose + 3, D);
    const T d[3] = {point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]};
    for (int k = 0; k < 3; ++k) q[k] = D[3 * k] * d[0] + D[3 * k + 1] * d[1] + D[3 * k + 2] * d[2];
    const Image<T> image = project(q, interior);
    residual[0] = (image.x - x) * weight;
    residual[1] = (image.y - y) * weight;
    return true;
  }
};

struct Frame {
  double D[9];
  double T[9];  // small rotation by omega, phi, kappa
};

class Frames : public ceres::EvaluationCallback {
 public:
  explicit Frames(const Block& block) : block_(block), frames(block.images) {}
  void PrepareForEvaluation(bool, bool new_point) override {
    if (!new_point) return;
    for (int64_t k = 0; k < block_.images; ++k) {
      const double* angles = &block_.pose[6 * k + 3];
      Frame& f = frames[k];
      rotation(angles, f.D);
      const double sp = std::sin(angles[1]), cp = std::cos(angles[1]);
      const double sk = std::sin(angles[2]), ck = std::cos(angles[2]);
      const double T[9] = {cp * ck, sk, 0.0, -cp * sk, ck, 0.0, sp, 0.0, 1.0};
      std::memcpy(f.T, T, sizeof(T));
    }
  }

 private:
  const Block& block_;

 public:
  std::vector<Frame> frames;
};

class Analytic : public ceres::SizedCostFunction<2, 6, 10, 3> {
 public:
  Analytic(const Frame& frame, double x, double y, double weight) : f_(frame), x_(x), y_(y), w_(weight) {}

  bool Evaluate(double const* const* values, double* residual, double** jacobians) const override {
    const double *X0 = values[0], *i = values[1], *X = values[2], *D = f_.D;
    const double d[3] = {X[0] - X0[0], X[1] - X0[1], X[2] - X0[2]};
    double q[3];
    for (int k = 0; k < 3; ++k) q[k] = D[3 * k] * d[0] + D[3 * k + 1] * d[1] + D[3 * k + 2] * d[2];
    const double inv = -1.0 / q[2], xc = q[0] * inv, yc = q[1] * inv;
    const double x = i[0] * xc, y = i[0] * yc;
    const double xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy, r4 = r2 * r2, r6 = r4 * r2;
    const double radial = i[3] * r2 + i[4] * r4 + i[5] * r6;
    const double slope = 2.0 * (i[3] + 2.0 * i[4] * r2 + 3.0 * i[5] * r4);
    residual[0] = w_ * (i[1] + x + x * radial + i[6] * (r2 + 2 * xx) + 2 * i[7] * xy + i[8] * x + i[9] * y - x_);
    residual[1] = w_ * (i[2] + y + y * radial + i[7] * (r2 + 2 * yy) + 2 * i[6] * xy - y_);
    if (!jacobians) return true;
    const double cross = slope * xy + 2.0 * (i[6] * y + i[7] * x);
    const double a = w_ * (1.0 + radial + slope * xx + 6.0 * i[6] * x + 2.0 * i[7] * y + i[8]);
    const double b = w_ * (cross + i[9]), c = w_ * cross;
    const double e = w_ * (1.0 + radial + slope * yy + 6.0 * i[7] * y + 2.0 * i[6] * x);
    const double s = i[0] * inv, xz = x * inv, yz = y * inv;
    const double star[2][3] = {{a * s, b * s, a * xz + b * yz}, {c * s, e * s, c * xz + e * yz}};
    for (int m = 0; m < 2; ++m) {
      const double* t = star[m];
      double own[3];
      for (int k = 0; k < 3; ++k) own[k] = t[0] * D[k] + t[1] * D[3 + k] + t[2] * D[6 + k];
      if (jacobians[0]) {
        double* J = jacobians[0] + 6 * m;
        const double turn[3] = {t[1] * q[2] - t[2] * q[1], t[2] * q[0] - t[0] * q[2], t[0] * q[1] - t[1] * q[0]};
        for (int k = 0; k < 3; ++k) {
          J[k] = -own[k];
          J[3 + k] = turn[0] * f_.T[k] + turn[1] * f_.T[3 + k] + turn[2] * f_.T[6 + k];
        }
      }
      if (jacobians[2])
        for (int k = 0; k < 3; ++k) jacobians[2][3 * m + k] = own[k];
    }
    if (jacobians[1]) {
      double* J = jacobians[1];
      const double w = w_;
      const double rows[20] = {a * xc + b * yc, w,   0.0, w * x * r2, w * x * r4, w * x * r6, w * (r2 + 2 * xx),
                               w * 2 * xy,      w * x, w * y,
                               c * xc + e * yc, 0.0, w,   w * y * r2, w * y * r4, w * y * r6, w * 2 * xy,
                               w * (r2 + 2 * yy), 0.0, 0.0};
      std::memcpy(J, rows, sizeof(rows));
    }
    return true;
  }

 private:
  const Frame& f_;
  double x_, y_, w_;
};

class Centre : public ceres::SizedCostFunction<3, 6> {
 public:
  Centre(const double* observed, double weight) : observed_(observed), w_(weight) {}
  bool Evaluate(double const* const* values, double* residual, double** jacobians) const override {
    for (int k = 0; k < 3; ++k) residual[k] = w_ * (values[0][k] - observed_[k]);
    if (jacobians && jacobians[0]) {
      std::memset(jacobians[0], 0, 18 * sizeof(double));
      for (int k = 0; k < 3; ++k) jacobians[0][7 * k] = w_;
    }
    return true;
  }

 private:
  const double* observed_;
  double w_;
};

struct Seconds {
  double cpu, wall;
};

Seconds now() {
  const auto wall = std::chrono::steady_clock::now().time_since_epoch();
  return {double(std::clock()) / CLOCKS_PER_SEC, std::chrono::duration<double>(wall).count()};
}

Seconds since(const Seconds& start) {
  const Seconds end = now();
  return {end.cpu - start.cpu, end.wall - start.wall};
}

// Called at the end of every iteration: the fastest interval is one iteration, without the analysis of the structure.
// Rejected steps end without derivatives and do not count; the last iteration of a solution is not reported at all.
class Watch : public ceres::IterationCallback {
 public:
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& step) override {
    if (step.iteration > 0 && step.step_is_successful) {
      const Seconds time = since(last_);
      fastest.cpu = std::min(fastest.cpu, time.cpu), fastest.wall = std::min(fastest.wall, time.wall);
    }
    last_ = now();
    return ceres::SOLVER_CONTINUE;
  }
  Seconds fastest{1e300, 1e300};

 private:
  Seconds last_{};
};

void add_residuals(Block& block, const Frames& frames, bool analytic, ceres::Problem& problem) {
  const double weight = 1.0 / block.sigma_image;
  for (int64_t n = 0; n < block.rays; ++n) {
    const int64_t k = block.image[n];
    const double* xy = &block.xy[2 * n];
    ceres::CostFunction* cost =
        analytic ? static_cast<ceres::CostFunction*>(new Analytic(frames.frames[k], xy[0], xy[1], weight))
                 : new ceres::AutoDiffCostFunction<Automatic, 2, 6, 10, 3>(new Automatic{xy[0], xy[1], weight});
    problem.AddResidualBlock(cost, nullptr, &block.pose[6 * k], block.interior.data(),
                             &block.point[3 * block.of_point[n]]);
  }
  for (int64_t k = 0; k < block.images; ++k)
    problem.AddResidualBlock(new Centre(&block.observed_centre[3 * k], 1.0 / block.sigma_centre), nullptr,
                             &block.pose[6 * k]);
}

// Points are eliminated first, then the rest.
std::shared_ptr<ceres::ParameterBlockOrdering> ordering_of(Block& block) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (int64_t p = 0; p < block.points; ++p) ordering->AddElementToGroup(&block.point[3 * p], 0);
  for (int64_t k = 0; k < block.images; ++k) ordering->AddElementToGroup(&block.pose[6 * k], 1);
  ordering->AddElementToGroup(block.interior.data(), 1);
  return ordering;
}

ceres::Solver::Options options_for(Block& block, const std::string& solver, int threads, bool gauss_newton) {
  ceres::Solver::Options options;
  options.linear_solver_type = solver == "sparse" ? ceres::SPARSE_SCHUR : ceres::DENSE_SCHUR;
  if (solver == "dense-lapack") options.dense_linear_algebra_library_type = ceres::LAPACK;
  options.linear_solver_ordering = ordering_of(block);
  options.num_threads = threads;
  if (gauss_newton) options.initial_trust_region_radius = 1e12;  // 1e4 by default: many more steps
  options.max_num_iterations = 50;
  options.logging_type = ceres::SILENT;
  return options;
}

// The solution at hand taken on to round-off; the objective there.
double exact_objective(ceres::Solver::Options options, ceres::Problem& problem) {
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 1e-16;
  options.initial_trust_region_radius = 1e12;
  options.max_num_iterations = 3;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return 2.0 * summary.final_cost;
}

// Distortion coefficients in units of what they do at a radius of 40 mm. Without it ceres::Covariance takes a sound
// block for rank deficient: the columns differ by thirteen powers of ten. The solver scales by itself.
class Scaled : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 10; }
  int TangentSize() const override { return 10; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    for (int k = 0; k < 10; ++k) sum[k] = x[k] + scale(k) * delta[k];
    return true;
  }
  bool Minus(const double* y, const double* x, double* difference) const override {
    for (int k = 0; k < 10; ++k) difference[k] = (y[k] - x[k]) / scale(k);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    std::memset(jacobian, 0, 100 * sizeof(double));
    for (int k = 0; k < 10; ++k) jacobian[11 * k] = scale(k);
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    std::memset(jacobian, 0, 100 * sizeof(double));
    for (int k = 0; k < 10; ++k) jacobian[11 * k] = 1.0 / scale(k);
    return true;
  }

 private:
  static double scale(int k) {
    static const int powers[10] = {0, 0, 0, 3, 5, 7, 2, 2, 1, 1};
    return std::pow(40.0, -powers[k]);
  }
};

struct Deviations {
  Seconds seconds;
  double principal_distance, points;  // sigma of c, and root mean square sigma of all point coordinates
};

// Covariances of every image, every point and the interior with itself: what standard deviations take.
Deviations covariances(Block& block, ceres::Problem& problem, int threads) {
  std::vector<std::pair<const double*, const double*>> blocks;
  for (int64_t k = 0; k < block.images; ++k) blocks.emplace_back(&block.pose[6 * k], &block.pose[6 * k]);
  for (int64_t p = 0; p < block.points; ++p) blocks.emplace_back(&block.point[3 * p], &block.point[3 * p]);
  const double* interior = block.interior.data();
  blocks.emplace_back(interior, interior);
  problem.SetManifold(block.interior.data(), new Scaled);
  ceres::Covariance::Options options;
  options.num_threads = threads;
  ceres::Covariance covariance(options);
  const Seconds start = now();
  if (!covariance.Compute(blocks, &problem)) std::exit(3);
  Deviations found{since(start), 0.0, 0.0};
  double q[100], trace = 0.0;
  covariance.GetCovarianceBlock(interior, interior, q);
  found.principal_distance = std::sqrt(q[0]);
  for (int64_t p = 0; p < block.points; ++p) {
    covariance.GetCovarianceBlock(&block.point[3 * p], &block.point[3 * p], q);
    trace += q[0] + q[4] + q[8];
  }
  found.points = std::sqrt(trace / (3.0 * double(block.points)));
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) return 2;
  Block block = read_block(argv[1]);
  const bool analytic = std::string(argv[2]) == "analytic";
  const int threads = std::stoi(argv[4]);
  Frames frames(block);
  frames.PrepareForEvaluation(true, true);
  ceres::Problem::Options ownership;
  if (analytic) ownership.evaluation_callback = &frames;
  ceres::Problem problem(ownership);
  add_residuals(block, frames, analytic, problem);

  const std::string more = argc > 5 ? argv[5] : "";
  Watch watch;
  ceres::Solver::Options options = options_for(block, argv[3], threads, more != "default-radius");
  options.callbacks.push_back(&watch);
  ceres::Solver::Summary summary;
  const Seconds start = now();
  ceres::Solve(options, &problem, &summary);
  const Seconds solve = since(start);
  const double own = summary.linear_solver_time_in_seconds / std::max(1, summary.num_linear_solves) +
                     summary.jacobian_evaluation_time_in_seconds / std::max(1, summary.num_jacobian_evaluations) +
                     summary.residual_evaluation_time_in_seconds / std::max(1, summary.num_residual_evaluations);
  const double objective = exact_objective(options, problem);  // its iterations are watched as well
  std::printf(
      "{\"iteration_cpu\": %.6f, \"iteration_wall\": %.6f, \"iteration_by_its_summary\": %.6f, \"iterations\": %zu, "
      "\"solve_cpu\": %.6f, \"solve_wall\": %.6f, \"converged\": %s, \"final_objective\": %.15g, "
      "\"objective\": %.15g",
      watch.fastest.cpu, watch.fastest.wall, own, summary.iterations.size() - 1, solve.cpu, solve.wall,
      summary.termination_type == ceres::CONVERGENCE ? "true" : "false", 2.0 * summary.final_cost,
      objective);
  if (more == "covariance") {
    const Deviations found = covariances(block, problem, threads);
    std::printf(", \"covariance_cpu\": %.6f, \"covariance_wall\": %.6f, \"sigma_c\": %.12g, \"sigma_points\": %.12g",
                found.seconds.cpu, found.seconds.wall, found.principal_distance, found.points);
  }
  std::printf("}\n");
  return 0;
}
