// A BAL file adjusted by Ceres Solver, from the values in the file.
//
//   bal FILE [FUNCTION_TOLERANCE]
//
// Image points are P = R X + t, p = -P / P_z, x = f (1 + k1 |p|^2 + k2 |p|^4) p. Options are those of Ceres, except the
// tolerances. Prints one JSON object with half the sum of squares.

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

namespace {

struct Snavely {
  double x, y;
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residual) const {
    T P[3];
    ceres::AngleAxisRotatePoint(camera, point, P);
    for (int k = 0; k < 3; ++k) P[k] += camera[3 + k];
    const T px = -P[0] / P[2], py = -P[1] / P[2], r2 = px * px + py * py;
    const T scale = camera[6] * (1.0 + r2 * (camera[7] + r2 * camera[8]));
    residual[0] = scale * px - x;
    residual[1] = scale * py - y;
    return true;
  }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  std::FILE* file = std::fopen(argv[1], "r");
  int cameras, points, rays;
  if (!file || std::fscanf(file, "%d %d %d", &cameras, &points, &rays) != 3) return 2;
  std::vector<int> camera(rays), point(rays);
  std::vector<double> xy(2 * rays), x(9 * cameras + 3 * points);
  for (int k = 0; k < rays; ++k)
    if (std::fscanf(file, "%d %d %lf %lf", &camera[k], &point[k], &xy[2 * k], &xy[2 * k + 1]) != 4) return 2;
  for (double& value : x)
    if (std::fscanf(file, "%lf", &value) != 1) return 2;
  std::fclose(file);

  ceres::Problem problem;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (int k = 0; k < rays; ++k) {
    double* of_point = &x[9 * cameras + 3 * point[k]];
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Snavely, 2, 9, 3>(new Snavely{xy[2 * k], xy[2 * k + 1]}),
                             nullptr, &x[9 * camera[k]], of_point);
    ordering->AddElementToGroup(&x[9 * camera[k]], 1);
    ordering->AddElementToGroup(of_point, 0);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = ordering;
  options.function_tolerance = argc > 2 ? std::atof(argv[2]) : 1e-6;
  options.gradient_tolerance = options.parameter_tolerance = 1e-14;
  options.max_num_iterations = 2000;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  int behind = 0;  // image points whose object point ends behind the camera
  for (int k = 0; k < rays; ++k) {
    double P[3];
    ceres::AngleAxisRotatePoint(&x[9 * camera[k]], &x[9 * cameras + 3 * point[k]], P);
    behind += P[2] + x[9 * camera[k] + 5] >= 0.0;
  }
  std::printf("{\"converged\": %s, \"cost\": %.17g, \"iterations\": %zu, \"behind\": %d}\n",
              summary.termination_type == ceres::CONVERGENCE ? "true" : "false", summary.final_cost,
              summary.iterations.size() - 1, behind);
  return 0;
}
