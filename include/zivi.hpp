// zivi for C++17: the functions of zivi.h and zivi_host.h with owners, exceptions and lambdas.
//
//     zivi::Run run = zivi::simulate({.force = -9.81, .e = 0.5}, 0.0, 4.0, 1.0, 6.0);   // C++20
//
// What is refused throws zivi::Error; what a function of yours throws comes out of the call in which
// it was called. A run that ended early is no error: Run::status() tells. Apache-2.0.
#ifndef ZIVI_HPP
#define ZIVI_HPP

#include <cmath>
#include <cstddef>
#include <exception>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "zivi.h"
#include "zivi_host.h"

namespace zivi {

/// A call was refused.
class Error : public std::runtime_error {
public:
    Error(std::int32_t code, const std::string &words) : std::runtime_error(words), code_(code) {}
    std::int32_t code() const noexcept { return code_; }

private:
    std::int32_t code_;
};

namespace detail {

/// The code of a call of zivi_host.h, if it is none of refusal.
inline std::int32_t checked(std::int32_t code)
{
    if (code < 0)
        throw Error(code, zivi_last_error());
    return code;
}

/// The same for zivi.h.
inline std::int32_t ticked(std::int32_t code)
{
    if (code < 0)
        throw Error(code, zivi_message(code));
    return code;
}

/// Calls a function of the user from C: what it throws is kept and thrown again later.
struct Kept {
    std::exception_ptr thrown;

    template <class Call> std::int32_t call(Call &&function) noexcept
    {
        try {
            function();
            return 0;
        } catch (...) {
            thrown = std::current_exception();
            return 1;
        }
    }

    void rethrow() const
    {
        if (thrown)
            std::rethrow_exception(thrown);
    }
};

/// What C++ keeps for the pointer of a callback.
template <class Function> struct Bound : Kept {
    explicit Bound(Function given) : function(std::move(given)) {}
    Function function;
};

} // namespace detail

/// A force per unit mass f(t, x, xdot) (m/s^2).
using Force = std::function<double(double, double, double)>;

/// What moves: a force, constant or not, and the wall.
struct System {
    double force = 0.0;
    double e = 0.0;
    Force function = nullptr;
};

/// How it is computed; what is 0 takes its default.
struct Method {
    double h = 0.0;
    double rtol = 0.0;
    double atol = 0.0;
    double max_step = 0.0;
    std::vector<double> t_eval = {};
};

/// A run.
class Run {
public:
    explicit Run(zivi_run *run) : run_(run) {}

    std::int32_t status() const { return zivi_run_status(run_.get()); }
    std::string message() const { return zivi_status_message(status()); }
    std::size_t size() const { return zivi_run_samples(run_.get()); }
    std::vector<double> t() const { return column(0); }
    std::vector<double> x() const { return column(1); }
    std::vector<double> xdot() const { return column(2); }
    /// The time from which it is at rest until the end, NaN if it is not.
    double rest_time() const { return zivi_run_rest_time(run_.get()); }

    std::vector<zivi_impact> impacts() const
    {
        std::size_t count = 0;
        const zivi_impact *first = zivi_run_impacts(run_.get(), &count);
        return count == 0 ? std::vector<zivi_impact>() : std::vector<zivi_impact>(first, first + count);
    }

private:
    struct Free {
        void operator()(zivi_run *run) const { zivi_run_free(run); }
    };

    std::vector<double> column(std::uint32_t number) const
    {
        const double *first = zivi_run_column(run_.get(), number);
        return std::vector<double>(first, first + size());
    }

    std::unique_ptr<zivi_run, Free> run_;
};

/// Simulates x'' = f, x >= 0, x'+ = -e x'-.
inline Run simulate(const System &system, double t0, double t1, double x0, double xdot0,
                    const Method &method = {})
{
    zivi_system plain;
    detail::checked(zivi_system_defaults(&plain));
    plain.e = system.e;
    plain.force = system.force;
    detail::Bound<Force> bound(system.function);
    if (system.function) {
        plain.user = &bound;
        plain.function = [](void *user, double t, double x, double xdot, double *force) {
            auto *it = static_cast<detail::Bound<Force> *>(user);
            return it->call([&] { *force = it->function(t, x, xdot); });
        };
    }
    zivi_method how;
    detail::checked(zivi_method_defaults(&how));
    how.h = method.h;
    how.rtol = method.rtol;
    how.atol = method.atol;
    how.max_step = method.max_step;
    if (!method.t_eval.empty()) {
        how.t_eval = method.t_eval.data();
        how.n_eval = method.t_eval.size();
    }
    zivi_run *run = nullptr;
    const std::int32_t code = zivi_simulate(&plain, &how, t0, t1, x0, xdot0, &run);
    Run owner(run);
    bound.rethrow();
    detail::checked(code);
    return owner;
}

/// F(z) of a box VI.
using Map = std::function<void(const std::vector<double> &, std::vector<double> &)>;

/// The solution of a box VI, or the best point found.
struct Solution {
    std::vector<double> z;
    zivi_vi_report report;
    bool solved() const { return report.status == 0 || report.status == 1; }
};

/// Solves a box VI with differences for its Jacobian; bounds that are empty are infinite.
inline Solution solve_vi(const Map &map, std::vector<double> start,
                         const std::vector<double> &lower = {},
                         const std::vector<double> &upper = {}, double tol = 0.0)
{
    const std::size_t n = start.size();
    if ((!lower.empty() && lower.size() != n) || (!upper.empty() && upper.size() != n))
        throw Error(ZIVI_E_INVALID, "lower and upper must be empty or as long as start");
    struct State : detail::Kept {
        const Map *map;
        std::vector<double> z, f;
    } state;
    state.map = &map;
    state.z.resize(n);
    state.f.resize(n);
    zivi_vi_problem problem;
    detail::checked(zivi_vi_defaults(&problem));
    problem.n = n;
    problem.lower = lower.empty() ? nullptr : lower.data();
    problem.upper = upper.empty() ? nullptr : upper.data();
    problem.tol = tol;
    problem.user = &state;
    problem.map = [](void *user, std::size_t length, const double *z, double *f) {
        auto *it = static_cast<State *>(user);
        return it->call([&] {
            it->z.assign(z, z + length);
            (*it->map)(it->z, it->f);
            if (it->f.size() != length)
                throw Error(ZIVI_E_INVALID, "the map must write as many numbers as there are");
            for (std::size_t k = 0; k < length; ++k)
                f[k] = it->f[k];
        });
    };
    Solution solution{std::move(start), {}};
    const std::int32_t code = zivi_solve_vi(&problem, solution.z.data(), &solution.report);
    state.rethrow();
    detail::checked(code);
    return solution;
}

/// The twisting tracker; zivi_tracker_defaults makes the settings.
class Tracker {
public:
    explicit Tracker(const zivi_tracker_config &config)
    {
        detail::ticked(zivi_tracker_init(&tracker_, &config));
    }

    void reset(double x_ref, double xdot_ref)
    {
        detail::ticked(zivi_tracker_reset(&tracker_, x_ref, xdot_ref));
    }

    /// The control for the period that starts with this measurement (m/s^2).
    double step(double x, double xdot, double force, double force_ref)
    {
        double u = 0.0;
        detail::ticked(zivi_tracker_step(&tracker_, x, xdot, force, force_ref, &u));
        return u;
    }

    const zivi_tracker &state() const noexcept { return tracker_; }

private:
    zivi_tracker tracker_{};
};

} // namespace zivi

#endif
