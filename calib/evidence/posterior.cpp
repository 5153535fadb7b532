#include "calib/evidence/posterior.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SparseCore>

namespace turncal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;

constexpr std::size_t beam = 6, expansions = 6;
constexpr double named_share = 0.3;       // part of a branch held by names, above which a pattern may stand for one
constexpr double as_good = 0.3;           // a fitted name stays if it has this part of another's probability
constexpr double averaged_share = 0.995;  // probability to average over, with at most most_averaged models
constexpr std::size_t most_averaged = 200;
constexpr int deepest = 8;  // terms of a model at most
constexpr double least_probability = 1e-5;
constexpr double negligible = 12.0, ends_below = 6.0;  // differences of log evidence
// A term that explains less changes nothing for the others: the model counts, and is not extended.
constexpr double explains = 1.0;
// A shape matters once its term is this many sigmas strong.
constexpr double strong = 10.0;
// An effect wrong by this part of itself does not follow its formula; one wrong by all of itself does not follow its driver.
constexpr double formula_is_within = 0.3, driver_is_within = 1.0;
// A curve that no shape of the table fits is spanned by several terms of its sensor. Beside such a curve, the probability that a
// weaker term is an effect of its own: of second branches on drawn recordings, docs/diagnosis.md.
constexpr double real_beside_a_curve = 0.4;
constexpr Eigen::Index most_columns = 240;  // of a model, up to which it still takes in columns of inexactness
constexpr double columns_show = 0.99;       // part of their information that the kept columns hold

// The system with a model eliminated.
struct State {
  std::vector<ModelTerm> terms;
  double log_weight = 0.0;
  std::vector<MatrixXd> Q;  // one per basis
  std::vector<VectorXd> s;
  MatrixXd Y;  // Q|h = Q - Y Y'
  VectorXd score;
};

// A state and one more term.
struct Next {
  double log_weight = 0.0;
  std::vector<ModelTerm> terms;
  ModelTerm last;
  std::shared_ptr<const State> parent;
};

// Columns with information A and score b, rotated so that A is tridiagonal: 1 + v A = L D L' for any variance v of their coefficients.
struct Turned {
  VectorXd diagonal, beside, score;
  Turned(const MatrixXd& A, const VectorXd& b) : diagonal(A.diagonal()), score(b) {
    if (b.size() == 1) return;
    const Eigen::Tridiagonalization<MatrixXd> of(A);
    diagonal = of.diagonal();
    beside = of.subDiagonal();
    score = of.matrixQ().adjoint() * b;
  }
  VectorXd gains(const VectorXd& variance) const {
    VectorXd gain = VectorXd::Zero(variance.size());
    for (Eigen::Index k = 0; k < variance.size(); ++k) {
      const double v = variance[k];
      double d = 1.0 + v * diagonal[0], y = score[0], log_det = std::log(d);
      for (Eigen::Index i = 1;; ++i) {
        gain[k] += 0.5 * v * y * y / d;
        if (i == score.size()) break;
        const double l = v * beside[i - 1] / d;
        d = 1.0 + v * diagonal[i] - l * v * beside[i - 1];
        y = score[i] - l * y;
        log_det += std::log(d);
      }
      gain[k] -= 0.5 * log_det;
    }
    return gain;
  }
};
// Returns the rotated columns of a term. They are the scaled basis itself, or most of them use a contiguous run of it.
Turned turned(const Term& term, const MatrixXd& Q, const VectorXd& s) {
  if (term.scale > 0.0) return {term.scale * term.scale * Q, term.scale * s};
  Eigen::Index from = 0, to = term.L.rows();
  while (from + 1 < to && term.L.row(from).isZero(0.0)) ++from;
  while (to > from + 1 && term.L.row(to - 1).isZero(0.0)) --to;
  const auto L = term.L.middleRows(from, to - from);
  const MatrixXd QL = Q.block(from, from, to - from, to - from) * L;
  return {L.transpose() * QL, L.transpose() * s.segment(from, to - from)};
}

// The sizes of a term that are worth scoring: the coarse grid, or, if its best size gains enough, the fine grid about that size.
struct Sizes {
  std::vector<int> at;  // of Term::variance
  VectorXd explained, log_prior;
};
Sizes sizes_of(const Term& term, const State& state, double enough) {
  Sizes sizes;
  const int all = int(term.variance.size());
  for (int k = 0; k < all; k += term.stride) sizes.at.push_back(k);
  const Turned columns = turned(term, state.Q[term.basis], state.s[term.basis]);
  sizes.explained = columns.gains(term.variance(sizes.at));
  sizes.log_prior = VectorXd(term.log_prior(sizes.at)).array() + std::log(term.stride);
  if (term.stride == 1) return sizes;
  Eigen::Index top = 0;
  if (!((sizes.explained + sizes.log_prior).maxCoeff(&top) > enough)) return sizes;
  const int middle = sizes.at[std::size_t(top)];
  sizes.at.clear();
  for (int k = std::max(0, middle - term.stride + 1); k < std::min(all, middle + term.stride); ++k)
    sizes.at.push_back(k);
  sizes.explained = columns.gains(term.variance(sizes.at));
  sizes.log_prior = term.log_prior(sizes.at);
  return sizes;
}

// Q|h x
MatrixXd left_by(const State& state, const PieceSystem& system, const MatrixXd& x) {
  MatrixXd y = system.times(x);
  if (state.Y.cols() > 0) y.noalias() -= state.Y * (state.Y.transpose() * x);
  return y;
}

// Adds columns x to a model, with y = Q|h x, M = x'y + 1/v and b = x's|h.
void take_in(const TermTable& table, const MatrixXd& y, const Eigen::LLT<MatrixXd>& M, const VectorXd& b,
             State& state) {
  const VectorXd w = M.matrixL().solve(b);
  const MatrixXd by_coordinate = M.matrixL().solve(y.transpose());
  state.Y.conservativeResize(y.rows(), state.Y.cols() + y.cols());
  state.Y.rightCols(y.cols()) = by_coordinate.transpose();
  state.score.noalias() -= by_coordinate.transpose() * w;
  for (std::size_t g = 0; g < table.bases.size(); ++g) {
    const MatrixXd u = table.bases[g].products(by_coordinate);
    MatrixXd& Q = state.Q[g];
    Q.selfadjointView<Eigen::Lower>().rankUpdate(u.transpose(), -1.0);
    Q.triangularView<Eigen::StrictlyUpper>() = Q.transpose();
    state.s[g].noalias() -= u.transpose() * w;
  }
}

// Returns the columns of inexactness of an error x, piece by piece: within the rest along its sensor's axis; at the turn before it in any
// direction, since an error in a turn rotates with the unit. Their size is that of x in the piece or, if the quantity has a unit, the rms
// of it and of x over all pieces: the true shape may be non-zero where the modelled one is zero. Keeps those with the most information.
Weights by_piece(const PieceSystem& system, const VectorXd& x, const VectorXd& unit, Eigen::Index most) {
  using OfPiece = Eigen::Matrix<double, piece_dims, 1>;
  struct Column {
    double information;
    Eigen::Index first;
    OfPiece of;
  };
  // Mean squares of x in units: readings within rests, attitude after turns, velocity after turns.
  struct Part {
    Eigen::Index at, wide;
    double square = 0.0, weight = 0.0;
  };
  std::array<Part, 3> parts = {Part{0, 6}, Part{6, 3}, Part{9, 3}};
  for (Eigen::Index first = 0; first < unit.size(); first += piece_dims) {
    const OfPiece seen = system.information(std::size_t(first / piece_dims)).diagonal();
    for (Part& p : parts) {
      const auto u = unit.segment(first + p.at, p.wide).cwiseAbs2();
      const double information = u.dot(seen.segment(p.at, p.wide));
      if (information > 0.0) p.square += information * x.segment(first + p.at, p.wide).squaredNorm() / u.sum();
      p.weight += information;
    }
  }
  const auto size = [&](std::size_t part, double local, double of_unit) {
    const Part& p = parts[part];
    return p.weight > 0.0 ? std::sqrt(0.5 * (local * local + p.square / p.weight * of_unit * of_unit)) : local;
  };
  std::vector<Column> columns;
  for (Eigen::Index first = 0; first < x.size(); first += piece_dims) {
    const OfPiece all = x.segment<piece_dims>(first),
                  one = unit.size() == 0 ? all : OfPiece(unit.segment<piece_dims>(first));
    if (all.isZero(0.0) && one.isZero(0.0)) continue;
    const OfPiece seen = system.information(std::size_t(first / piece_dims)).diagonal();
    const auto add = [&](const OfPiece& of) { columns.push_back({of.cwiseAbs2().dot(seen), first, of}); };
    OfPiece rest = OfPiece::Zero();
    const OfPiece& along = one.head<6>().isZero(0.0) ? all : one;
    const double norm = along.head<6>().norm();
    if (norm > 0.0) rest.head<6>() = along.head<6>() / norm * size(0, all.head<6>().norm(), one.head<6>().norm());
    add(rest);
    for (int d = 6; d < piece_dims; ++d) {
      const std::size_t part = d < 9 ? 1 : 2;
      const Eigen::Index from = parts[part].at;
      add(size(part, all.segment<3>(from).norm(), one.segment<3>(from).norm()) * OfPiece::Unit(d));
    }
  }
  std::ranges::sort(columns, [](const Column& a, const Column& b) { return a.information > b.information; });
  double left = 0.0;
  for (const Column& column : columns) left += columns_show * column.information;
  std::size_t count = 0;
  while (count < columns.size() && Eigen::Index(count) < most && left > 0.0) left -= columns[count++].information;
  columns.resize(count);
  std::ranges::stable_sort(columns, {}, &Column::first);
  Weights side_by_side;
  side_by_side.columns = std::ssize(columns);
  side_by_side.mine = 1;
  for (std::size_t k = 0; k < columns.size(); ++k) {
    side_by_side.begin.resize(std::size_t(columns[k].first / piece_dims) + 1, side_by_side.rows.size());
    for (int d = 0; d < piece_dims; ++d) {
      if (columns[k].of[d] == 0.0) continue;
      side_by_side.rows.push_back(columns[k].first + d);
      side_by_side.first.push_back(Eigen::Index(k));
      side_by_side.values.push_back(columns[k].of[d]);
    }
  }
  side_by_side.begin.resize(std::size_t(x.size() / piece_dims) + 1, side_by_side.rows.size());
  return side_by_side;
}
VectorXd unit_of(const TermTable& table, const Term& term, Eigen::Index coordinates) {
  if (term.unit < 0) return {};
  const Weights& basis = table.bases[std::size_t(term.unit)];
  return basis.times(MatrixXd::Ones(basis.columns, 1), coordinates);
}

// Hand-turned data have no units (Term::unit): there patterns alone may be inexact, each piece in proportion to itself.
bool may_be_inexact(const Term& term) {
  return term.kind == TermKind::pattern || (term.kind == TermKind::effect && term.unit >= 0);
}

State with_term(const PieceSystem& system, const TermTable& table, const Next& next) {
  const Term& term = table.terms[std::size_t(next.last.term)];
  State child = *next.parent;
  child.terms = next.terms;
  child.log_weight = next.log_weight;
  const MatrixXd x = table.bases[term.basis].times(term.L, system.coordinates());
  MatrixXd M = term.L.transpose() * child.Q[term.basis] * term.L;
  M.diagonal().array() += 1.0 / term.variance[next.last.size];
  const Eigen::LLT<MatrixXd> llt(M);
  const VectorXd b = term.L.transpose() * child.s[term.basis], mean = llt.solve(b);
  const double explained = b.dot(mean);
  take_in(table, left_by(child, system, x), llt, b, child);
  if (!may_be_inexact(term) || explained < strong * strong || child.Y.cols() >= most_columns) return child;
  const Weights C =
      by_piece(system, x * mean, unit_of(table, term, system.coordinates()), most_columns - child.Y.cols());
  const MatrixXd taken = C.products(child.Y.transpose());
  const MatrixXd A = system.blocks({C}).front().Q - taken.transpose() * taken;
  const VectorXd s = C.products(child.score.transpose()).transpose();
  const VectorXd variance = Eigen::Map<const Eigen::ArrayXd>(inexactness.data(), inexactness.size()).square();
  const VectorXd gain = Turned(A, s).gains(variance);
  Eigen::Index best = 0;
  const double top = gain.maxCoeff(&best);
  const Eigen::ArrayXd odds = (gain.array() - top).exp();
  child.log_weight += top + std::log(odds.mean());
  const auto within = [&](double limit) {
    return odds.head(std::ranges::lower_bound(inexactness, limit) - inexactness.begin()).sum() / odds.sum();
  };
  for (ModelTerm& t : child.terms)
    if (t == next.last)
      t = {t.term, t.size, int(best), within(formula_is_within), within(driver_is_within), t.explained};
  if (best == 0) return child;
  M = A;
  M.diagonal().array() += 1.0 / variance[best];
  const MatrixXd y = left_by(child, system, C.times(MatrixXd::Identity(C.columns, C.columns), system.coordinates()));
  take_in(table, y, Eigen::LLT<MatrixXd>(M), s, child);
  return child;
}

}  // namespace

// A missing effect can pass for noise, so each noise model is searched by itself. A model far below `elsewhere`, the
// most probable model at another noise, is extended only by terms that are more likely than not.
LogWeights weigh_models(const UnderNoise& under, double elsewhere) {
  const TermTable& table = *under.table;
  auto root = std::make_shared<State>();
  root->log_weight = under.log_prior - 0.5 * under.system->misfit();
  root->score = under.system->scores();
  for (const PieceSystem::Block& b : under.blocks) {
    root->Q.push_back(b.Q);
    root->s.push_back(b.s);
  }
  double best = root->log_weight;
  LogWeights seen = {{{}, root->log_weight}};
  std::vector<std::shared_ptr<const State>> level = {root};
  for (int depth = 0; depth < deepest && !level.empty(); ++depth) {
    std::vector<Next> next;
    for (const std::shared_ptr<const State>& state : level) {
      std::vector<Next> of_state;
      for (std::size_t t = 0; t < table.terms.size(); ++t) {
        const Term& term = table.terms[t];
        if (std::ranges::count(state->terms, int(t), &ModelTerm::term) > 0) continue;
        const Sizes sizes = sizes_of(term, *state, best - negligible - state->log_weight);
        const VectorXd gain = sizes.explained + sizes.log_prior;
        Eigen::Index top = 0;
        gain.maxCoeff(&top);
        for (Eigen::Index k = 0; k < gain.size(); ++k) {
          const double log_weight = state->log_weight + gain[k];
          if (!(log_weight > best - negligible)) continue;
          Next one = {log_weight, state->terms, {int(t), sizes.at[std::size_t(k)]}, state};
          one.last.explained = sizes.explained[k];
          one.terms.push_back(one.last);
          std::sort(one.terms.begin(), one.terms.end());
          seen.emplace(one.terms, log_weight);
          if (k == top && sizes.explained[k] > explains) of_state.push_back(std::move(one));
        }
      }
      const auto heavier = [](const Next& a, const Next& b) { return a.log_weight > b.log_weight; };
      std::ranges::sort(of_state, heavier);
      of_state.resize(std::min(of_state.size(), expansions));
      next.insert(next.end(), of_state.begin(), of_state.end());
      std::ranges::sort(next, heavier);
    }
    if (depth + 1 == deepest) break;
    std::vector<std::shared_ptr<const State>> deeper;
    std::set<std::vector<int>> done;
    for (const Next& one : next) {
      best = std::max(best, one.log_weight);
      if (deeper.size() == beam || one.log_weight < best - ends_below) break;
      if (one.log_weight < std::min(elsewhere - ends_below, one.parent->log_weight)) continue;
      std::vector<int> of;
      for (const ModelTerm& m : one.terms) of.push_back(m.term);
      if (!done.insert(of).second) continue;
      deeper.push_back(std::make_shared<State>(with_term(*under.system, table, one)));
      seen.erase(one.terms);
      seen[deeper.back()->terms] = deeper.back()->log_weight;
      best = std::max(best, deeper.back()->log_weight);
    }
    level = std::move(deeper);
  }
  return seen;
}

Posterior posterior_of(const std::vector<LogWeights>& at_each_noise) {
  Posterior result;
  std::vector<WeighedModel>& models = result.models;
  double best = -1e300, sum = 0.0, kept = 0.0;
  for (std::size_t noise = 0; noise < at_each_noise.size(); ++noise)
    for (const auto& [terms, log_weight] : at_each_noise[noise]) {
      models.push_back({terms, noise, log_weight});
      best = std::max(best, log_weight);
    }
  for (WeighedModel& m : models) sum += m.probability = std::exp(m.probability - best);
  result.log_evidence = best + std::log(sum);
  std::erase_if(models, [&](const WeighedModel& m) { return m.probability < least_probability * sum; });
  for (const WeighedModel& m : models) kept += m.probability;
  for (WeighedModel& m : models) m.probability /= kept;
  std::ranges::sort(models, [](const WeighedModel& a, const WeighedModel& b) { return a.probability > b.probability; });
  return result;
}

std::size_t averaged_models(const Posterior& posterior) {
  double kept = 0.0;
  std::size_t count = 0;
  for (; count < std::min(posterior.models.size(), most_averaged) && kept <= averaged_share; ++count)
    kept += posterior.models[count].probability;
  return count;
}

namespace {

// Is a term more likely than not exact enough to be its formula?
bool is_formula(const Term& term, const ModelTerm& t) { return term.kind == TermKind::effect && t.formula >= 0.5; }

// What a model holds of one sensor: the strongest term, and whether every term follows a formula.
struct OfSensor {
  const Statement* strongest = nullptr;
  double explained = 0.0;
  bool formulas = true;
};
std::map<std::string, OfSensor> by_sensor(const TermTable& table, const WeighedModel& model) {
  std::map<std::string, OfSensor> all;
  for (const ModelTerm& t : model.terms) {
    const Term& term = table.terms[std::size_t(t.term)];
    if (term.kind == TermKind::noise) continue;
    OfSensor& of = all[term.what.sensor];
    of.formulas = of.formulas && is_formula(term, t);
    if (of.strongest != nullptr && t.explained < of.explained) continue;
    of.strongest = &term.what;
    of.explained = t.explained;
  }
  return all;
}

}  // namespace

Statements statements_of(const std::vector<UnderNoise>& under, const Posterior& posterior) {
  Statements all;
  all.tested = true;
  using Node = std::array<std::string, 4>;  // sensor, quantity, driver, formula; empty: left open
  std::map<Node, double> nodes;
  for (const WeighedModel& m : posterior.models) {
    std::map<Node, double> mine;  // probability that no term of the model says so
    const auto says = [&](const Node& node, double probability) {
      mine.emplace(node, 1.0).first->second *= 1.0 - probability;
    };
    const auto says_branch = [&](const Statement& w, double quantity, double driver) {
      says({w.sensor, "", "", ""}, 1.0);
      says({w.sensor, w.quantity, "", ""}, quantity);
      says({w.sensor, w.quantity, w.driver, ""}, quantity * driver);
    };
    if (const Statement& w = under[m.noise].what; !w.sensor.empty()) says_branch(w, 1.0, 1.0);
    const std::map<std::string, OfSensor> of_sensor = by_sensor(*under[m.noise].table, m);
    for (const ModelTerm& t : m.terms) {
      const Term& term = under[m.noise].table->terms[std::size_t(t.term)];
      if (term.kind == TermKind::noise) continue;
      const Statement& w = term.what;
      const OfSensor& of = of_sensor.at(w.sensor);
      const double real = of.formulas || of.strongest == &w ? 1.0 : real_beside_a_curve;
      const bool same = w.quantity == of.strongest->quantity && w.driver == of.strongest->driver;
      says_branch(w, same ? 1.0 : real, term.unit < 0 ? 1.0 : t.driver);
      if (term.kind == TermKind::effect) says({w.sensor, w.quantity, w.driver, w.formula}, real * t.formula);
    }
    if (!mine.empty()) all.anything += m.probability;
    for (const auto& [node, not_said] : mine) nodes[node] += m.probability * (1.0 - not_said);
  }
  // As a tree: children follow their parent, the more probable first.
  using Path = std::vector<std::pair<double, std::string>>;
  std::vector<std::pair<Path, Node>> listed;
  for (const auto& [node, p] : nodes) {
    if (p <= listed_from) continue;
    Path path;
    Node above;
    for (std::size_t k = 0; k < node.size() && !node[k].empty(); ++k) {
      above[k] = node[k];
      path.emplace_back(-nodes[above], node[k]);
    }
    listed.emplace_back(path, node);
  }
  std::ranges::sort(listed);
  for (const auto& [path, node] : listed)
    all.nodes.push_back({node[0], node[1], node[2], node[3], std::min(nodes[node], 1.0)});
  all.anything = std::min(all.anything, 1.0);
  return all;
}

NamedEffects named_effects(const std::vector<UnderNoise>& under, const Posterior& posterior,
                           const std::vector<std::string>& fitted) {
  const TermTable& table = *under.front().table;  // effects are the same in all
  // A branch is a sensor and a quantity: names that share it may stand for each other.
  using Branch = std::pair<std::string, std::string>;
  const auto branch = [](const Statement& what) { return Branch{what.sensor, what.quantity}; };
  std::map<Branch, double> any, by_name;
  std::vector<std::pair<std::set<std::string>, double>> held;  // keys of each model, and its probability
  std::map<std::string, EffectColumn> column_of;
  std::map<std::string, Branch> branch_of;
  std::map<std::string, std::pair<double, double>> log_tau;
  const auto term_of = [&](const WeighedModel& m, const ModelTerm& t) -> const Term& {
    return under[m.noise].table->terms[std::size_t(t.term)];
  };
  for (const WeighedModel& m : posterior.models) {
    std::set<Branch> mine, named;
    if (const Branch b = branch(under[m.noise].what); b != Branch{}) mine.insert(b);
    for (const ModelTerm& t : m.terms) {
      if (term_of(m, t).kind == TermKind::noise) continue;
      mine.insert(branch(term_of(m, t).what));
      if (is_formula(term_of(m, t), t)) named.insert(branch(term_of(m, t).what));
    }
    for (const Branch& b : mine) any[b] += m.probability;
    for (const Branch& b : named) by_name[b] += m.probability;
  }
  NamedEffects result;
  double something = 0.0;
  for (const WeighedModel& m : posterior.models) {
    std::set<std::string> keys;
    std::set<Branch> mine;
    bool missing = false, stands = true;
    for (const ModelTerm& t : m.terms)
      if (is_formula(term_of(m, t), t)) mine.insert(branch(term_of(m, t).what));
    const auto has_no_name = [&](const Branch& b) {
      missing = true;
      stands = stands && mine.count(b) == 0 && by_name[b] > named_share * any[b];
    };
    if (const Branch b = branch(under[m.noise].what); b != Branch{}) has_no_name(b);
    for (const ModelTerm& t : m.terms) {
      const Term& term = term_of(m, t);
      if (term.kind == TermKind::noise) continue;
      if (!is_formula(term, t)) {
        has_no_name(branch(term.what));
        continue;
      }
      missing = true;
      for (const int c : term.columns) {
        const EffectColumn& column = table.effects[std::size_t(c)];
        const std::string key = column.key();
        stands = keys.insert(key).second && stands;  // a key at two time constants is no name
        column_of[key] = column;
        branch_of[key] = branch(term.what);
        log_tau[key].first += m.probability * std::log(column.tau_s);
        log_tau[key].second += m.probability;
      }
    }
    if (!missing) continue;
    something += m.probability;
    if (stands) result.probability += m.probability;
    if (!keys.empty()) held.emplace_back(std::move(keys), m.probability);
  }
  if (something > 0.0) result.probability /= something;
  // Takes names while one is more likely than not beside those taken (the first in any case): of the most probable branch, the most probable name.
  std::set<std::string> names;
  for (;;) {
    std::map<Branch, double> with;
    std::map<std::string, double> beside;
    double all = 0.0;
    for (const auto& [keys, probability] : held) {
      if (!std::ranges::includes(keys, names)) continue;
      all += probability;
      std::map<Branch, double> mine;
      for (const std::string& key : keys) {
        if (names.count(key) > 0) continue;
        const double weight = probability / (std::ranges::count(fitted, key) > 0 ? as_good : 1.0);
        beside[key] += weight;
        mine[branch_of[key]] = std::max(mine[branch_of[key]], weight);
      }
      for (const auto& [of, weight] : mine) with[of] += weight;
    }
    const auto likelier = [](const auto& a, const auto& b) { return a.second < b.second; };
    const auto best = std::ranges::max_element(with, likelier);
    if (best == with.end() || (!names.empty() && best->second < 0.5 * all)) break;
    std::erase_if(beside, [&](const auto& one) { return branch_of[one.first] != best->first; });
    names.insert(std::ranges::max_element(beside, likelier)->first);
  }
  for (const std::string& key : names) {
    result.columns.push_back(column_of[key]);
    result.columns.back().tau_s = std::exp(log_tau[key].first / log_tau[key].second);  // without one: exp(-inf)
    result.instead[std::string(column_of[key].entry->name)];
  }
  for (const WeighedModel& m : posterior.models) {
    std::set<std::string> formulas;
    for (const ModelTerm& t : m.terms)
      if (is_formula(term_of(m, t), t)) formulas.insert(term_of(m, t).what.formula);
    for (auto& [name, others] : result.instead)
      if (formulas.count(name) == 0)
        for (const std::string& f : formulas)
          if (result.instead.count(f) == 0) others[f] += m.probability;
  }
  return result;
}

namespace {

struct OfModel {
  double probability;
  VectorXd mean;
  MatrixXd covariance;
};

// Returns the probability that a number is below x, in a mixture of normal distributions.
double below(const std::vector<OfModel>& models, Eigen::Index i, double x) {
  double sum = 0.0, all = 0.0;
  for (const OfModel& m : models) {
    sum += m.probability * 0.5 * std::erfc((m.mean[i] - x) / std::sqrt(2.0 * m.covariance(i, i)));
    all += m.probability;
  }
  return sum / all;
}
// Returns its quantile at probability `p`.
double quantile(const std::vector<OfModel>& models, Eigen::Index i, double p) {
  double low = 1e300, high = -1e300;
  for (const OfModel& m : models) {
    const double sigma = std::sqrt(m.covariance(i, i));
    low = std::min(low, m.mean[i] - 8.0 * sigma);
    high = std::max(high, m.mean[i] + 8.0 * sigma);
  }
  for (int k = 0; k < 40; ++k) {
    const double x = 0.5 * (low + high);
    (below(models, i, x) < p ? low : high) = x;
  }
  return 0.5 * (low + high);
}

// Q and s of the terms of averaged models, and their effect on [parameters over the recording, parameters at zero named effects, named values].
class Coefficients {
 public:
  Coefficients(const UnderNoise& under, const std::vector<EffectColumn>& named)
      : system_(*under.system), table_(*under.table), blocks_(under.blocks) {
    for (const EffectColumn& c : named) named_.push_back(c.key());
  }
  OfModel evaluate(const WeighedModel& model) {
    const Eigen::Index p = system_.covariance().rows(), n = 2 * p + Eigen::Index(named_.size());
    OfModel result = {model.probability, VectorXd::Zero(n), MatrixXd::Zero(n, n)};
    result.mean.head(2 * p) = system_.fit_shift().replicate(2, 1);
    result.covariance.topLeftCorner(2 * p, 2 * p) = system_.covariance().replicate(2, 2);
    if (model.terms.empty()) return result;
    const Solution of = solve(model);
    const MatrixXd effect = beside(of.columns, &Part::effect, n), half = of.llt.matrixL().solve(effect.transpose());
    result.mean += half.transpose() * of.llt.matrixL().solve(of.s);
    result.covariance += half.transpose() * half;
    return result;
  }

  Explained explain(const WeighedModel& model) {
    if (model.terms.empty()) return {MatrixXd(system_.coordinates(), 0), VectorXd::Zero(0)};
    const Solution of = solve(model);
    for (const Column& c : of.columns) y_of(parts_[c.part]);
    const MatrixXd y = beside(of.columns, &Part::y, system_.coordinates());
    return {of.llt.matrixL().solve(y.transpose()).transpose(), of.llt.matrixL().solve(of.s)};
  }
  bool holds_names(const WeighedModel& model) const {
    std::set<std::string> held;
    for (const ModelTerm& t : model.terms)
      for (const int c : table_.terms[std::size_t(t.term)].columns) held.insert(table_.effects[std::size_t(c)].key());
    return std::ranges::all_of(named_, [&](const std::string& name) { return held.contains(name); });
  }

 private:
  struct Part {
    SparseMatrix x;
    MatrixXd y, effect;  // y: computed on demand
    VectorXd s;
    MatrixXd information;
  };
  struct Column {
    std::size_t part;
    double variance;
  };
  struct Solution {
    std::vector<Column> columns;
    VectorXd s;
    Eigen::LLT<MatrixXd> llt;  // of the coefficients' information, with their priors
  };

  // The inexactness of a term is built on its mean in the first model that holds it.
  Solution solve(const WeighedModel& model) {
    Solution of;
    for (const ModelTerm& t : model.terms)
      of.columns.push_back({place_of(t.term), table_.terms[std::size_t(t.term)].variance[t.size]});
    const auto terms = of.columns.size();
    const auto decompose = [&] { of.llt.compute(system_of(of.columns, of.s)); };
    decompose();
    VectorXd mean;
    Eigen::Index first = 0;
    for (std::size_t k = 0; k < terms; ++k) {
      const ModelTerm& t = model.terms[k];
      const Eigen::Index wide = parts_[of.columns[k].part].x.cols();
      if (t.inexact > 0) {
        const auto [found, is_new] = places_.emplace(t, parts_.size());
        if (is_new) {
          if (mean.size() == 0) mean = of.llt.solve(of.s);
          add_inexact(parts_[of.columns[k].part].x * mean.segment(first, wide), table_.terms[std::size_t(t.term)]);
        }
        of.columns.push_back({found->second, std::pow(inexactness[std::size_t(t.inexact)], 2)});
      }
      first += wide;
    }
    if (of.columns.size() > terms) decompose();
    return of;
  }
  MatrixXd beside(const std::vector<Column>& columns, MatrixXd Part::*of, Eigen::Index rows) const {
    Eigen::Index wide = 0;
    for (const Column& c : columns) wide += (parts_[c.part].*of).cols();
    MatrixXd all(rows, wide);
    Eigen::Index at = 0;
    for (const Column& c : columns) {
      const MatrixXd& one = parts_[c.part].*of;
      all.middleCols(at, one.cols()) = one;
      at += one.cols();
    }
    return all;
  }

  void add_inexact(const VectorXd& mean, const Term& term) {
    Part part;
    const Weights C = by_piece(system_, mean, unit_of(table_, term, system_.coordinates()), most_columns);
    const MatrixXd x = C.times(MatrixXd::Identity(C.columns, C.columns), system_.coordinates());
    part.x = x.sparseView();
    part.s = C.products(system_.scores().transpose()).transpose();
    part.information = system_.blocks({C}).front().Q;
    const MatrixXd shift = system_.shift(x);
    part.effect = MatrixXd::Zero(2 * shift.rows() + Eigen::Index(named_.size()), shift.cols());
    part.effect.topRows(2 * shift.rows()) = shift.replicate(2, 1);
    parts_.push_back(std::move(part));
  }
  std::size_t place_of(int number) {
    const auto [found, is_new] = places_.emplace(ModelTerm{number, -1, 0}, parts_.size());
    if (!is_new) return found->second;
    const Term& term = table_.terms[std::size_t(number)];
    Part part;
    part.x = table_.bases[term.basis].times(term.L, system_.coordinates()).sparseView();
    part.s = term.L.transpose() * blocks_[term.basis].s;
    part.information = term.L.transpose() * blocks_[term.basis].Q * term.L;
    const MatrixXd& shift = blocks_[term.basis].shift;
    MatrixXd taken_up = double(term.about_mean) * table_.taken_up[term.basis];
    const Eigen::Index p = shift.rows();
    part.effect = MatrixXd::Zero(2 * p + Eigen::Index(named_.size()), term.L.cols());
    part.effect.topRows(p) = (shift + taken_up) * term.L;
    for (const int c : term.columns) {
      const int at = table_.column_of_effect[std::size_t(c)];
      const auto name = std::ranges::find(named_, table_.effects[std::size_t(c)].key());
      if (name == named_.end()) continue;
      taken_up.col(at).setZero();
      part.effect.row(2 * p + (name - named_.begin())) = term.L.row(at);
    }
    part.effect.middleRows(p, p) = (shift + taken_up) * term.L;
    parts_.push_back(std::move(part));
    return parts_.size() - 1;
  }

  // Returns the information of the coefficients with their priors, and sets their score.
  MatrixXd system_of(const std::vector<Column>& columns, VectorXd& s) {
    Eigen::Index r = 0;
    for (const Column& c : columns) r += parts_[c.part].x.cols();
    MatrixXd M(r, r);
    s.resize(r);
    Eigen::Index row = 0;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const Part& part = parts_[columns[i].part];
      const Eigen::Index m = part.x.cols();
      Eigen::Index column = row;
      for (std::size_t j = i; j < columns.size(); ++j) {
        const MatrixXd& block = between(columns[i].part, columns[j].part);
        M.block(row, column, block.rows(), block.cols()) = block;
        M.block(column, row, block.cols(), block.rows()) = block.transpose();
        column += block.cols();
      }
      M.diagonal().segment(row, m).array() += 1.0 / columns[i].variance;
      s.segment(row, m) = part.s;
      row += m;
    }
    return M;
  }

  const MatrixXd& y_of(Part& part) {
    if (part.y.size() == 0) part.y = system_.times(part.x);
    return part.y;
  }
  const MatrixXd& between(std::size_t i, std::size_t j) {
    if (i == j) return parts_[i].information;
    MatrixXd& block = between_[{i, j}];
    if (block.size() == 0) block = parts_[i].x.transpose() * y_of(parts_[j]);
    return block;
  }

  const PieceSystem& system_;
  const TermTable& table_;
  const std::vector<PieceSystem::Block>& blocks_;
  std::vector<std::string> named_;
  std::map<std::pair<std::size_t, std::size_t>, MatrixXd> between_;
  std::map<ModelTerm, std::size_t> places_;  // part of a term (size -1), and of its inexactness
  std::vector<Part> parts_;
};

}  // namespace

Explained explained_by(const UnderNoise& under, const WeighedModel& model) {
  return Coefficients(under, {}).explain(model);
}

AveragedEstimate average_over_models(const std::vector<UnderNoise>& under, const Posterior& posterior,
                                     const std::vector<EffectColumn>& named) {
  const Eigen::Index p = under.front().system->covariance().rows(), n = p + Eigen::Index(named.size());
  std::vector<Coefficients> coefficients;
  for (const UnderNoise& one : under) coefficients.emplace_back(one, named);
  std::vector<OfModel> all, with_names;
  for (std::size_t k = 0; k < averaged_models(posterior); ++k) {
    const WeighedModel& m = posterior.models[k];
    all.push_back(coefficients[m.noise].evaluate(m));
    if (coefficients[m.noise].holds_names(m)) with_names.push_back(all.back());
  }
  if (with_names.empty()) with_names = all;
  AveragedEstimate estimate;
  double weight = 0.0;
  VectorXd mean = VectorXd::Zero(n);
  for (const OfModel& m : with_names) {
    mean += m.probability * m.mean.tail(n);
    weight += m.probability;
  }
  mean /= weight;
  MatrixXd covariance = MatrixXd::Zero(n, n);
  for (const OfModel& m : with_names) {
    const VectorXd off = m.mean.tail(n) - mean;
    covariance += m.probability / weight * (m.covariance.bottomRightCorner(n, n) + off * off.transpose());
  }
  constexpr double one_sigma = 0.15865525393145707;
  estimate.shift = estimate.sigma = VectorXd(n);
  estimate.taken_up = estimate.far_off = VectorXd(p);
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::vector<OfModel>& of = i < p ? all : with_names;
    estimate.shift[i] = quantile(of, p + i, 0.5);
    estimate.sigma[i] = 0.5 * (quantile(of, p + i, 1.0 - one_sigma) - quantile(of, p + i, one_sigma));
    if (i >= p) continue;
    estimate.taken_up[i] = quantile(all, i, 0.5) - estimate.shift[i];
    const double far = far_sigmas * estimate.sigma[i];
    estimate.far_off[i] = 1.0 - below(all, p + i, estimate.shift[i] + far) + below(all, p + i, estimate.shift[i] - far);
  }
  const VectorXd scale = estimate.sigma.cwiseQuotient(covariance.diagonal().cwiseMax(1e-300).cwiseSqrt());
  estimate.covariance = scale.asDiagonal() * covariance * scale.asDiagonal();
  return estimate;
}

std::string hangs_on_a_name(const AveragedEstimate& estimate, const std::vector<int>& columns) {
  std::string words;
  double most = 1.0 - said_from;
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const double far_off = estimate.far_off[Eigen::Index(k)];
    if (columns[k] >= parameter_count || !(far_off > most)) continue;
    most = far_off;
    words = fmt::format("{} is off by more than {} sigma with a probability of {}", parameter_key(columns[k]),
                        far_sigmas, words_of_probability(far_off));
  }
  return words;
}

}  // namespace turncal
