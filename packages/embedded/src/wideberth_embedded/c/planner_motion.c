/* Trajectories that the robot can drive, without solving anything: what rollout, starts, stopping
 * and command_limits do in Python. */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

void wb_column(wb_function *function, const double *v, const double *p, double *out)
{
    const int64_t next = sizeof(double);
    function(NULL, 0, 1, v, next, p, next, out, next, NULL);
}

static void call(wb_function *one, const double *first, int count, const double *second, int more,
    double *found)
{
    double given[2 * NX + NU + 8];
    memcpy(given, first, (size_t)count * sizeof(double));
    if (more) memcpy(given + count, second, (size_t)more * sizeof(double));
    wb_column(one, given, given, found);
}

void wb_pose(const double *state, double *pose)
{
    call(wideberth_plan_pose, state, NX, NULL, 0, pose);
}

void wb_twist(const double *state, const double *input, double *twist)
{
    call(wideberth_plan_twist, state, NX, input, NU, twist);
}

void wb_drive(const double *state, const double *twist, double *input)
{
    call(wideberth_plan_drive, state, NX, twist, 3, input);
}

void wb_next(const double *state, const double *input, double *next)
{
    double found[NX];
    call(wideberth_plan_step, state, NX, input, NU, found);
    memcpy(next, found, sizeof(found));
}

static void state_at(const double *pose, const double *twist, double *state)
{
    call(wideberth_plan_state_at, pose, 3, twist, 3, state);
}

/* The twist of a robot some time after the command of another one. */
static void attained(wb_function *drive, double duration, const double *state, const double *wanted,
    double *twist)
{
    double input[NU], rates[NX], later[NX];
    int r;
    call(drive, state, NX, wanted, 3, input);
    call(wideberth_plan_rates, state, NX, input, NU, rates);
    for (r = 0; r < NX; r++) later[r] = state[r] + duration * rates[r];
    wb_twist(later, input, twist);
}

void wb_attained(const double *last, const double *wanted, double duration, double *twist)
{
    const double pose[3] = {0.0, 0.0, 0.0};
    double given[4], state[NX], input[NU], rates[NX], later[NX];
    int r;
    memcpy(given, wanted, 3 * sizeof(double)), given[3] = duration;
    state_at(pose, last, state);
    call(wideberth_plan_drive_within, state, NX, given, 4, input);
    call(wideberth_plan_rates, state, NX, input, NU, rates);
    for (r = 0; r < NX; r++) later[r] = state[r] + duration * rates[r];
    wb_twist(later, input, twist);
}

void wb_follow(const double *start, double (*inputs)[NU], double (*states)[NX])
{
    int i;
    memmove(states[0], start, NX * sizeof(double));
    for (i = 0; i < N; i++) wb_next(states[i], inputs[i], states[i + 1]);
}

void wb_clip_inputs(double (*inputs)[NU])
{
    int i, r;
    for (i = 0; i < N; i++)
        for (r = 0; r < NU; r++)
            inputs[i][r] = fmin(fmax(inputs[i][r], PLAN_LOWER[NX + r]), PLAN_UPPER[NX + r]);
}

void wb_within_bounds(const double *state, double *found)
{
    int r;
    for (r = 0; r < NX; r++) found[r] = fmin(fmax(state[r], PLAN_LOWER[r]), PLAN_UPPER[r]);
}

void wb_steer(const double *start, const double *first, int count, const double *second,
    double (*states)[NX], double (*inputs)[NU])
{
    int i;
    memcpy(states[0], start, NX * sizeof(double));
    for (i = 0; i < N; i++) {
        wb_drive(states[i], i < count ? first : second, inputs[i]);
        wb_next(states[i], inputs[i], states[i + 1]);
    }
}

void wb_brake(const double *start, double (*states)[NX], double (*inputs)[NU])
{
    const double still[3] = {0.0, 0.0, 0.0};
    wb_steer(start, still, N, still, states, inputs);
}

void wb_sweep(const double *start, int name, double speed, const double *now, double *twist)
{
    const double none[NU] = {0.0};
    const double sign = name == PLAN_LEFT || name == PLAN_BACK_LEFT ? 1.0 : -1.0;
    if (now)
        memcpy(twist, now, 3 * sizeof(double));
    else
        wb_twist(start, none, twist);
    if (name == PLAN_COAST) return;
    if (name == PLAN_WAIT) {
        twist[0] = twist[1] = twist[2] = 0.0;
        return;
    }
    if (name == PLAN_BACK_LEFT || name == PLAN_BACK_RIGHT) twist[0] = -speed, twist[1] = 0.0;
    twist[2] = sign * speed;
}

/* The way from a pose to the middle of the reference. */
static void to_reference(const wideberth_problem *problem, const double *pose, double *way)
{
    int i, r;
    way[0] = way[1] = 0.0;
    for (i = 0; i < N; i++)
        for (r = 0; r < 2; r++) way[r] += problem->reference[i][r];
    for (r = 0; r < 2; r++) way[r] = way[r] / N - pose[r];
}

static int behind(const double *pose, const double *way)
{
    return cos(pose[2]) * way[0] + sin(pose[2]) * way[1] < 0.0;
}

/* Whether the reference lies or begins behind a robot that drives backwards less fast. */
int wb_faces_away(const wideberth_problem *problem)
{
    static const double ENDS[3][3]
        = {{PLAN_BEYOND, 0.0, 0.0}, {-PLAN_BEYOND, 0.0, 0.0}, {0.0, 0.0, PLAN_BEYOND}};
    const double *end = problem->reference[N - 1];
    double here[3], way[2], found[3][3];
    int k;
    wb_pose(problem->initial, here);
    to_reference(problem, here, way);
    if (!behind(here, way) && !behind(here, problem->direction[0])) return 0;
    if (hypot(end[0] - here[0], end[1] - here[1]) <= PLAN_RADIUS) return 0;
    for (k = 0; k < 3; k++)
        attained(wideberth_plan_drive_ever, PLAN_FOREVER, problem->initial, ENDS[k],
            found[k]);
    return -found[1][0] < found[0][0] && found[2][2] != 0.0;
}

/* The twist in which the robot turns on the spot until it looks along the path, or else to the
 * reference, and for how many steps: its yaw rate, which falls as fast as it can, then brings it
 * there. */
int wb_turn(const wideberth_problem *problem, double *spin)
{
    const double none[NU] = {0.0};
    double states[N + 1][NX], inputs[N][NU], pose[3], twist[3], opposite[3], found[3];
    double way[2], heading, missing, sign, slowing;
    int k;
    wb_pose(problem->initial, pose);
    heading = pose[2];
    memcpy(way, problem->direction[0], sizeof(way));
    if (!behind(pose, way)) to_reference(problem, pose, way);
    missing = atan2(way[1], way[0]) - heading;
    missing -= 2.0 * PI * rint(missing / (2.0 * PI));
    sign = copysign(1.0, missing);
    spin[0] = spin[1] = opposite[0] = opposite[1] = 0.0;
    spin[2] = sign * PLAN_BEYOND, opposite[2] = -spin[2];
    wb_steer(problem->initial, spin, N, spin, states, inputs);
    attained(wideberth_plan_drive, WIDEBERTH_DT, problem->initial, opposite, found);
    wb_twist(problem->initial, none, twist);
    slowing = fabs(found[2] - twist[2]) / WIDEBERTH_DT;
    for (k = 0; k < N; k++) {
        double turned, rate;
        wb_pose(states[k], pose);
        wb_twist(states[k], none, twist);
        turned = sign * (pose[2] - heading), rate = sign * twist[2];
        if (rate * fabs(rate) >= 2.0 * slowing * (fabs(missing) - turned)) break;
    }
    return k;
}

void wb_shift(double (*inputs)[NU], double share, double (*found)[NU])
{
    int whole = (int)fmin(share + 1e-9, N), i, r;
    double part;
    if (whole < 0) whole = 0;
    part = fmin(fmax(share - whole, 0.0), 1.0);
    for (i = 0; i < N; i++) {
        for (r = 0; r < NU; r++) {
            const double here = i + whole < N ? inputs[i + whole][r] : 0.0;
            const double after = i + whole + 1 < N ? inputs[i + whole + 1][r] : 0.0;
            found[i][r] = (1.0 - part) * here + part * after;
        }
    }
}

/* Directions of travel without a jump by a turn; standing keeps the one before. */
static void headings(double (*velocities)[2], const double *speeds, double first, double *found)
{
    double angles[N + 1], turned = 0.0;
    int i, jumps = 0;
    angles[0] = first;
    for (i = 0; i < N; i++) {
        angles[i + 1] = speeds[i] > 1e-6 ? atan2(velocities[i][1], velocities[i][0]) : angles[i];
        jumps = jumps || !(fabs(angles[i + 1] - angles[i]) < PI);
    }
    for (i = 0; i < N; i++) {
        const double way = angles[i + 1] - angles[i];
        if (jumps && !(fabs(way) < PI)) {
            double rest = fmod(way + PI, 2.0 * PI);
            if (rest < 0.0) rest += 2.0 * PI;
            rest -= PI;
            if (rest == -PI && way > 0.0) rest = PI;
            turned += rest - way;
        }
        found[i] = angles[i + 1] + turned;
    }
}

void wb_laid(const wideberth_problem *problem, double (*states)[NX], double (*inputs)[NU])
{
    double here[3], velocities[N][2], speeds[N], turned[N], twists[N][3], pose[3];
    int i, r;
    wb_pose(problem->initial, here);
    for (i = 0; i < N; i++) {
        const double *before = i ? problem->reference[i - 1] : here;
        for (r = 0; r < 2; r++)
            velocities[i][r] = (problem->reference[i][r] - before[r]) / WIDEBERTH_DT;
        speeds[i] = sqrt(velocities[i][0] * velocities[i][0] + velocities[i][1] * velocities[i][1]);
    }
    headings(velocities, speeds, here[2], turned);
    memcpy(states[0], problem->initial, sizeof(problem->initial));
    for (i = 0; i < N; i++) {
        double found[NX];
        twists[i][0] = speeds[i], twists[i][1] = twists[i][2] = 0.0;
        pose[0] = problem->reference[i][0], pose[1] = problem->reference[i][1], pose[2] = turned[i];
        state_at(pose, twists[i], found);
        wb_within_bounds(found, states[i + 1]);
    }
    for (i = 0; i < N; i++) wb_drive(states[i], twists[i], inputs[i]);
    wb_clip_inputs(inputs);
}

int wb_stops(const double *start, double fastest, double (*states)[N + 1][NX],
    double (*inputs)[N][NU])
{
    const double still[3] = {0.0, 0.0, 0.0}, none[NU] = {0.0};
    static const int SHARES[3] = {6, 3, 2};
    double now[3];
    int k, s, found = 0;
    wb_brake(start, states[found], inputs[found]);
    found++;
    wb_twist(start, none, now);
    for (k = 0; k < 6; k++) { /* turning, swerving, ahead and back; to the left first */
        const double sign = k % 2 ? -1.0 : 1.0, ahead = fastest > 0.0 ? fastest : PLAN_FAST;
        double twist[3] = {0.0, 0.0, 0.0};
        if (k < 2) twist[2] = sign * PLAN_FAST;
        if (k == 2 || k == 3) twist[0] = now[0], twist[2] = sign;
        if (k > 3) twist[0] = sign * ahead;
        for (s = 0; s < 3; s++) {
            int away = (int)rint((double)N / SHARES[s]);
            away = away < 1 ? 1 : away > N ? N : away;
            wb_steer(start, twist, away, still, states[found], inputs[found]);
            found++;
        }
    }
    return found;
}

/* ---- The command, within what the robot can do */

static double beyond(const double *values, int count, int first)
{
    double worst = -INFINITY;
    int r;
    for (r = 0; r < count; r++) {
        worst = fmax(worst, values[r] - PLAN_UPPER[first + r]);
        worst = fmax(worst, PLAN_LOWER[first + r] - values[r]);
    }
    return worst;
}

static int broken(const wideberth_command *command)
{
    const double none[NX] = {0.0}, wanted[3]
        = {command->linear[0], command->linear[1], command->omega};
    double pose[3], state[NX], input[NU], found[3], worst;
    int r;
    if (!(isfinite(wanted[0]) && isfinite(wanted[1]) && isfinite(wanted[2])
            && isfinite(command->ramp) && command->ramp >= 0.0))
        return 1;
    wb_pose(none, pose);
    state_at(pose, wanted, state);
    call(wideberth_plan_drive_second, state, NX, wanted, 3, input);
    wb_twist(state, input, found);
    worst = fmax(beyond(state, NX, 0), beyond(input, NU, NX));
    for (r = 0; r < 3; r++) worst = fmax(worst, fabs(found[r] - wanted[r]));
#if PLAN_LIMITS > 0
    {
        double limits[PLAN_LIMITS];
        call(wideberth_plan_limits, state, NX, input, NU, limits);
        for (r = 0; r < PLAN_LIMITS; r++) worst = fmax(worst, -limits[r]);
    }
#endif
    return !(worst <= PLAN_ALLOWANCE);
}

static void within_reach(wideberth_command *command)
{
    const double none[NX] = {0.0}, still[3] = {0.0, 0.0, 0.0}, wanted[3]
        = {command->linear[0], command->linear[1], command->omega};
    double pose[3], rest[NX], twist[3], ramp = command->ramp;
    if (!broken(command)) return;
    memset(command, 0, sizeof(*command));
    if (!(isfinite(wanted[0]) && isfinite(wanted[1]) && isfinite(wanted[2]) && isfinite(ramp)))
        return;
    wb_pose(none, pose);
    state_at(pose, still, rest);
    attained(wideberth_plan_drive_ever, PLAN_FOREVER, rest, wanted, twist);
    command->linear[0] = twist[0], command->linear[1] = twist[1], command->omega = twist[2];
    command->ramp = fmax(ramp, 0.0);
    if (broken(command)) memset(command, 0, sizeof(*command));
}

void wb_limited(const double *state, const double *input, wideberth_command *command)
{
    double twist[3], other[3], more[NU];
    int r;
    for (r = 0; r < NU; r++) more[r] = input[r] + 1.0;
    wb_twist(state, input, twist);
    wb_twist(state, more, other);
    command->linear[0] = twist[0], command->linear[1] = twist[1], command->omega = twist[2];
    command->ramp = memcmp(twist, other, sizeof(twist)) ? 0.0 : WIDEBERTH_DT;
    within_reach(command);
}
