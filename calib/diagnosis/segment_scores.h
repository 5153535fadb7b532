// What each piece of rest says against the model: score tests of a bias within the piece and of a jump at its beginning.
//
// The filter of the estimate (calib/joint/joint_filter.h) is run backward over its own steps (the disturbance smoother of de Jong,
// Biometrika 75 (1988) 594; Harvey and Koopman, J. Bus. Econ. Stat. 10 (1992) 377, for its use in tests of lack of fit). With
// z = (state error x, bias b of gyros and accelerometers within the piece at hand), L its closed-loop transition, H its
// derivative of the innovation nu with covariance S, and N' the innovations' derivatives by the model's own columns:
//   r <- H' S^-1 nu + L' r,   I <- H' S^-1 H + L' I L,   R <- H' S^-1 N' + L' R
// r is then the score of an error z that begins there, I its information, R its information with the columns. What the columns
// (base parameters and effects, information A) imitate is eliminated: Q = I - R A^-1 R', s' Q^-1 s ~ chi2(rank).
// Between two pieces the state carries the information: with E = d(state where the next piece begins)/dz, M the state's transition
// over a piece and the turn after it, and G = information of (state, z) at the beginning of a piece,
//   I_ab = E_a' M_(a+1)' ... M_(b-1)' G_b for a < b
// to whatever distance: the heading and slow biases are remembered to the end of a run.
//
// A dwell is cut into pieces where it is long, and after its first seconds, so that what comes with a turn and fades shows.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"
#include "calib/model/limits.h"

namespace turncal {

inline constexpr int piece_dims = 12;  // bias of gyro x y z, of accelerometer x y z (body); jump of psi and v (n frame)
inline const std::vector<int> bias_dims = {0, 1, 2, 3, 4, 5}, jump_dims = {6, 7, 8, 9, 10, 11};

struct Turn {                                           // between two pieces, a segment at a time
  int turn = 0;                                         // its number, from 1
  Eigen::Vector3d table_rad = Eigen::Vector3d::Zero();  // commanded heading, pitch, roll half way
  double temperature_c = 0.0;                           // minus the reference
  double length_s = 0.0;
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // body axes, rad: over length_s it is the rate
  // Column i: C_nb e_i w_i, C_nb e_i, C_nb e_i f_i / g integrated over it: what a scale factor of gyro i turns, what a bias turns or
  // pushes, what a scale factor of accelerometer i pushes.
  Eigen::Matrix3d turned = Eigen::Matrix3d::Zero(), pushed = Eigen::Matrix3d::Zero(), lifted = Eigen::Matrix3d::Zero();
  // What has been turned too far by a scale factor, or by a bias, tilts gravity until the turn ends: the velocity of that, -F psi integrated.
  Eigen::Matrix3d fallen_turned = Eigen::Matrix3d::Zero(), fallen_pushed = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rate_radps() const { return length_s > 0.0 ? Eigen::Vector3d(rotation / length_s) : rotation; }
  // The unit turns on: over t more seconds by so much.
  void go_on(const Eigen::Matrix3d& F, double t, const Eigen::Matrix3d& more_turned,
             const Eigen::Matrix3d& more_pushed);
};

struct Piece {
  std::size_t first_step = 0, last_step = 0;
  int segment = 0;
  bool after_turn = false;            // the first piece of a dwell
  double begin_s = 0.0, end_s = 0.0;  // from the first sample
  double since_turn_s = 0.0;          // at its beginning
  double temperature_c = 0.0;         // mean, minus the reference
  Eigen::Matrix3d C_nb = Eigen::Matrix3d::Identity();
  int turn = 0;                                         // how many turns came before
  Eigen::Vector3d table_rad = Eigen::Vector3d::Zero();  // commanded
  std::vector<Turn> turns;                              // since the piece before
  Eigen::Matrix3d turned() const, fallen() const;       // of all of them: turned, fallen_turned
};

// Nuisance columns by what they weigh in each piece. Of hundreds, one for every turn, a piece has a few: they are made where they are used.
struct Weights {
  struct Part {  // of a piece: columns first, first + 1, ...
    Eigen::Index first = 0;
    Eigen::Matrix<double, piece_dims, Eigen::Dynamic> of;
  };
  Eigen::Index columns = 0;
  std::function<Part(const Piece&)> at;
  bool summed = false;  // column k is the sum of all after k, and the last one goes: steps where these are values
};

class SegmentScores {
 public:
  // `pass`: run with keep_steps; its information is of the same columns as the steps' N. `columns`: those of the model.
  // `prior`: information on them from elsewhere (a holdout: from the fit), or empty.
  SegmentScores(const CompressedRecording& recording, const FilterResult& pass, const std::vector<int>& columns,
                double reference_temperature_c, const LackOfFitLimits& limits, const Eigen::MatrixXd& prior = {});

  const std::vector<Piece>& pieces() const { return pieces_; }
  // Score and information of nuisance columns, the model's columns eliminated.
  struct Test {
    Eigen::VectorXd s;
    Eigen::MatrixXd Q;
    Eigen::VectorXd before;  // diagonal of Q before the elimination
    Eigen::MatrixXd shift;   // change of the model's columns for one unit of each
  };
  // Each by itself, side by side.
  std::vector<Test> tests(const std::vector<Weights>& weights) const;
  // Multiple correlation of a column of the model with such a test's, the others eliminated: at 1 they imitate it.
  double correlation(const Test& test, Eigen::Index column, double floor) const;
  // Of some of the piece_dims of one piece.
  Test test(std::size_t piece, const std::vector<int>& dims) const;
  // Of the scores of some pieces in some of the piece_dims, `whiten` (rank x dims) of each: traces of their covariance C, C^2 and C^3.
  // C is never whole: its columns come a few pieces at a time, and what it does to a column goes along the pieces as the information does.
  struct Whitened {
    std::size_t piece;
    Eigen::MatrixXd whiten;
  };
  std::array<double, 3> traces(const std::vector<int>& dims, const std::vector<Whitened>& scores) const;

 private:
  Eigen::MatrixXd covariance_times(const std::vector<int>& dims, const std::vector<Whitened>& scores,
                                   const Eigen::MatrixXd& columns) const;
  // `states`: 6 (psi, v) or 12 (with the biases).
  void run(int states, const FilterResult& pass, const CompressedRecording& recording, const std::vector<int>& columns);

  std::vector<Piece> pieces_;
  Eigen::VectorXd s_;
  struct Link {
    Eigen::Matrix<double, piece_dims, piece_dims> I;         // of the piece with itself
    Eigen::Matrix<double, Eigen::Dynamic, piece_dims> E, G;  // states x piece_dims
    Eigen::MatrixXd M;                                       // states x states
  };
  std::vector<Link> links_;  // of each piece, to the next
  Eigen::MatrixXd R_;        // rows() x columns
  Eigen::MatrixXd A_inverse_;
};

// s' Q^-1 s on the directions that hold more than `floor` of what they had before the elimination.
struct RankedChiSquare {
  double chi_square = 0.0;
  int rank = 0;
  Eigen::VectorXd estimate;  // of the weights' columns
  Eigen::MatrixXd whiten;    // rank x dims: chi_square = |whiten s|^2
};
RankedChiSquare ranked_chi_square(const SegmentScores::Test& test, double floor);

}  // namespace turncal
