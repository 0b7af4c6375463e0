// The rival of the benchmark: the identification as one writes it with Ceres, compiled where Ceres is installed.
//
// Place in the flow: `main.rs` compiles it, writes a campaign and runs it. Input: a text file, one reading a row: station, x, y, z, ox, oy,
// oz, length (m); then the strokes (m) and the number of intervals. Output, first line: seconds of the solver, unknowns, chi2 per degree of
// freedom; then the 18 errors at 21 places each (m, rad).
//
// An easier problem than Abbe's: no penalties (so that no smoothness is sought), no robust weights, no covariance; partials of small angles at
// the nominal point. Stations and dead paths start from a linear solve. Analytic Jacobian, one core.

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

namespace {

using Eigen::Vector3d;

constexpr double kConstantM = 0.025e-6, kPerMetre = 0.15e-6, kRepeatM = 0.25e-6;
constexpr int kErrors = 18, kPlaces = 21, kOrder = 4;

struct Reading {
  int station;
  Vector3d at, offset;
  double length;
};

// Splines of one number of intervals; the coefficient at the lower end is left out, of straightness that at the upper end too.
struct Layout {
  std::array<std::array<double, 2>, 3> stroke;
  int intervals = 9;
  std::array<int, kErrors> first{}, count{};
  int machine = 0;

  void Fill() {
    for (int k = 0; k < kErrors; ++k) {
      const int axis = k / 6, component = k % 6;
      count[k] = intervals + 2 - (component < 3 && component != axis ? 1 : 0);
      first[k] = machine;
      machine += count[k];
    }
    machine += 6;  // three squareness, three of the turn of the ram
  }

  // The four cubic B-splines that are not zero at a share of the stroke, and the number of the first of them.
  int Basis(double t, std::array<double, kOrder>* values) const {
    const int span = std::min(static_cast<int>(t * intervals), intervals - 1);
    const auto knot = [&](int i) { return std::clamp((i - 3.0) / intervals, 0.0, 1.0); };
    (*values) = {1, 0, 0, 0};
    std::array<double, kOrder> left{}, right{};
    for (int j = 1; j < kOrder; ++j) {
      left[j] = t - knot(span + 4 - j);
      right[j] = knot(span + 3 + j) - t;
      double saved = 0;
      for (int r = 0; r < j; ++r) {
        const double temp = (*values)[r] / (right[r + 1] + left[j - r]);
        (*values)[r] = saved + right[r + 1] * temp;
        saved = left[j - r] * temp;
      }
      (*values)[j] = saved;
    }
    return span;
  }
};

// One range: residual and partials by the machine's unknowns and by those of the station.
class Range : public ceres::CostFunction {
 public:
  Range(const Layout& layout, const Reading& reading, const Vector3d& mean_offset, double u)
      : layout_(layout), length_(reading.length), nominal_(reading.at + reading.offset), u_(u) {
    set_num_residuals(1);
    *mutable_parameter_block_sizes() = {layout.machine, 4};
    Vector3d arm = reading.offset;
    for (int axis = 2; axis >= 0; --axis) {
      const auto [low, high] = layout.stroke[axis];
      span_[axis] = layout.Basis((reading.at[axis] - low) / (high - low), &basis_[axis]);
      for (int d = 0; d < 3; ++d) {
        moved_[6 * axis + d] = Vector3d::Unit(d);
        moved_[6 * axis + 3 + d] = Vector3d::Unit(d).cross(arm);
      }
      arm += reading.at[axis] * Vector3d::Unit(axis);
    }
    const double y = reading.at[1] - layout.stroke[1][0], z = reading.at[2] - layout.stroke[2][0];
    const Vector3d about = reading.offset - mean_offset;
    constant_ = {-y * Vector3d::UnitX(),         z * Vector3d::UnitX(),           -z * Vector3d::UnitY(),
                 Vector3d::UnitX().cross(about), Vector3d::UnitY().cross(about), Vector3d::UnitZ().cross(about)};
  }

  bool Evaluate(double const* const* x, double* residual, double** jacobian) const override {
    Vector3d sight = nominal_ - Vector3d(x[1][0], x[1][1], x[1][2]);
    Each([&](int k, const Vector3d& moved, double value) { sight += x[0][k] * value * moved; });
    const double distance = sight.norm();
    residual[0] = (distance - x[1][3] - length_) / u_;
    if (jacobian == nullptr) return true;
    const Vector3d ray = sight / (distance * u_);
    if (jacobian[0] != nullptr) {
      std::fill_n(jacobian[0], layout_.machine, 0.0);
      Each([&](int k, const Vector3d& moved, double value) { jacobian[0][k] += value * moved.dot(ray); });
    }
    if (jacobian[1] != nullptr) {
      for (int d = 0; d < 3; ++d) jacobian[1][d] = -ray[d];
      jacobian[1][3] = -1.0 / u_;
    }
    return true;
  }

 private:
  template <typename Visit>
  void Each(Visit visit) const {
    for (int k = 0; k < kErrors; ++k) {
      for (int j = 0; j < kOrder; ++j) {
        const int own = span_[k / 6] + j - 1;
        if (own >= 0 && own < layout_.count[k]) visit(layout_.first[k] + own, moved_[k], basis_[k / 6][j]);
      }
    }
    for (int j = 0; j < 6; ++j) visit(layout_.machine - 6 + j, constant_[j], 1.0);
  }

  const Layout& layout_;
  double length_;
  Vector3d nominal_;
  double u_;
  std::array<int, 3> span_{};
  std::array<std::array<double, kOrder>, 3> basis_{};
  std::array<Vector3d, kErrors> moved_;
  std::array<Vector3d, 6> constant_;
};

// Station and dead path of ranges to nominal points: |p|² − 2 p·S + |S|² − d² = l² + 2 l d is linear in S, d and |S|² − d².
std::array<double, 4> Start(const std::vector<Reading>& all, int station) {
  std::vector<const Reading*> own;
  for (const Reading& r : all) {
    if (r.station == station) own.push_back(&r);
  }
  Eigen::MatrixXd a(own.size(), 5);
  Eigen::VectorXd b(own.size());
  for (size_t i = 0; i < own.size(); ++i) {
    const Vector3d p = own[i]->at + own[i]->offset;
    const double l = own[i]->length;
    a.row(i) << -2 * p.x(), -2 * p.y(), -2 * p.z(), -2 * l, 1.0;
    b[i] = l * l - p.squaredNorm();
  }
  const Eigen::VectorXd found = a.colPivHouseholderQr().solve(b);
  return {found[0], found[1], found[2], found[3]};
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 9) return 2;
  Layout layout;
  for (int axis = 0; axis < 3; ++axis) {
    layout.stroke[axis] = {std::atof(arguments[2 + 2 * axis]), std::atof(arguments[3 + 2 * axis])};
  }
  layout.intervals = std::atoi(arguments[8]);
  layout.Fill();
  std::vector<Reading> readings;
  std::ifstream file(arguments[1]);
  Vector3d mean = Vector3d::Zero();
  int stations = 0;
  for (Reading r; file >> r.station >> r.at[0] >> r.at[1] >> r.at[2] >> r.offset[0] >> r.offset[1] >> r.offset[2] >> r.length;) {
    readings.push_back(r);
    mean += r.offset;
    stations = std::max(stations, r.station + 1);
  }
  if (readings.empty()) return 3;
  mean /= static_cast<double>(readings.size());

  std::vector<double> machine(layout.machine, 0.0);
  std::vector<std::array<double, 4>> places;
  for (int k = 0; k < stations; ++k) places.push_back(Start(readings, k));

  ceres::Problem problem;
  for (const Reading& r : readings) {
    const auto& at = places[r.station];
    const double distance = (r.at + r.offset - Vector3d(at[0], at[1], at[2])).norm();
    const double u = std::hypot(kConstantM + kPerMetre * distance, kRepeatM);
    problem.AddResidualBlock(new Range(layout, r, mean, u), nullptr, machine.data(), places[r.station].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.dense_linear_algebra_library_type = ceres::LAPACK;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  const auto begin = std::chrono::steady_clock::now();
  ceres::Solve(options, &problem, &summary);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();

  const int unknowns = layout.machine + 4 * stations;
  const double freedom = static_cast<double>(readings.size()) - unknowns;
  std::printf("%.6f %d %.4f\n", seconds, unknowns, 2.0 * summary.final_cost / freedom);
  for (int k = 0; k < kErrors; ++k) {
    for (int place = 0; place < kPlaces; ++place) {
      std::array<double, kOrder> basis;
      const int span = layout.Basis(place / (kPlaces - 1.0), &basis);
      double value = 0;
      for (int j = 0; j < kOrder; ++j) {
        const int own = span + j - 1;
        if (own >= 0 && own < layout.count[k]) value += machine[layout.first[k] + own] * basis[j];
      }
      std::printf("%.9e\n", value);
    }
  }
  return summary.IsSolutionUsable() ? 0 : 4;
}
