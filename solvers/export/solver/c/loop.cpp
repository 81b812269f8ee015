// The same drive as in loop.c, in C++: a planner that owns its memory, and throws what goes wrong.
#include "wideberth_solver.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <stdexcept>
#include <vector>

namespace {

using Point = std::array<double, 2>;
using State = std::array<double, WIDEBERTH_STATES>;

struct Obstacle {
    Point place, velocity;

    Point at(double time) const
    {
        return {place[0] + velocity[0] * time, place[1] + velocity[1] * time};
    }
};

class Planner {
public:
    explicit Planner(std::vector<Point> path) : path_(std::move(path)) {}

    const wideberth_result &plan(
        const State &state, double now, const std::vector<Obstacle> &obstacles)
    {
        wideberth_problem &problem = *problem_;
        check(wideberth_begin(&problem));
        std::copy(state.begin(), state.end(), problem.initial);
        const auto *points = reinterpret_cast<const double(*)[2]>(path_.data());
        check(wideberth_follow(
            &problem, points, static_cast<int>(path_.size()), WIDEBERTH_SPEED, &arc_));
        for (int k = 0; k < WIDEBERTH_OBSTACLES && k < static_cast<int>(obstacles.size()); k++)
            forecast(k, obstacles[static_cast<std::size_t>(k)], now);
        check(wideberth_start(&problem, planned_ ? result_.get() : nullptr, 1.0));
        check(wideberth_solve(&problem, memory_.data(), memory_.size(), result_.get()));
        planned_ = true;
        return *result_;
    }

    double violation() const { return wideberth_violation(problem_.get(), result_.get()); }

private:
    static void check(int error)
    {
        if (error) throw std::runtime_error(wideberth_error_text(error));
    }

    void forecast(int slot, const Obstacle &one, double now)
    {
        double mean[WIDEBERTH_HORIZON][2], covariance[WIDEBERTH_HORIZON][4];
        for (int i = 0; i < WIDEBERTH_HORIZON; i++) {
            const double ahead = (i + 1) * WIDEBERTH_DT;
            const double along = 0.01 + 0.02 * ahead, across = 0.01 + 0.005 * ahead;
            const bool upright = one.velocity[0] == 0.0;
            const Point place = one.at(now + ahead);
            mean[i][0] = place[0], mean[i][1] = place[1];
            covariance[i][0] = upright ? across : along;
            covariance[i][1] = covariance[i][2] = 0.002 * ahead;
            covariance[i][3] = upright ? along : across;
        }
        check(wideberth_set(
            problem_.get(), WIDEBERTH_KIND_OBSTACLE, slot, mean, covariance, 0.3));
    }

    std::vector<Point> path_;
    std::vector<unsigned char> memory_ = std::vector<unsigned char>(WIDEBERTH_MEMORY);
    std::unique_ptr<wideberth_problem> problem_{new wideberth_problem()};
    std::unique_ptr<wideberth_result> result_{new wideberth_result()};
    double arc_ = -1.0;
    bool planned_ = false;
};

} // namespace

int main()
try {
    const std::vector<Obstacle> obstacles = {
        {{4.0, 2.5}, {0.0, -0.3}}, {{8.0, -3.5}, {0.0, 0.25}}, {{11.0, 0.4}, {-0.25, 0.0}}};
    Planner planner({{0.0, 0.0}, {12.0, 0.0}});
    State state{};
    const int cycles = 60;
    double closest = INFINITY;
    int unsolved = 0;
    for (int cycle = 0; cycle < cycles; cycle++) {
        const double now = cycle * WIDEBERTH_DT;
        const wideberth_result &plan = planner.plan(state, now, obstacles);
        unsolved += plan.status != WIDEBERTH_SOLVED;
        wideberth_step(state.data(), plan.inputs[0], state.data());
        for (int k = 0; k < WIDEBERTH_OBSTACLES && k < static_cast<int>(obstacles.size()); k++) {
            const Point at = obstacles[static_cast<std::size_t>(k)].at(now + WIDEBERTH_DT);
            closest = std::fmin(closest, std::hypot(at[0] - state[0], at[1] - state[1]));
        }
        if (cycle % 10 == 0)
            std::printf("%5.1f s  (%6.3f, %6.3f) m  %s, %d iterations, broken by %.1e\n", now,
                state[0], state[1], wideberth_status_text(plan.status), plan.iterations,
                planner.violation());
    }
    std::printf("at (%.6f, %.6f) m; an obstacle came within %.6f m; %d of %d without a plan\n",
        state[0], state[1], closest, unsolved, cycles);
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
