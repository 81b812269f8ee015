/* Histories of obstacles: measurements by identity, laid onto a uniform time grid. What
 * wideberth.framework.tracking does in Python: history, stand_ins, resampling. */
#include "planner_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define OLDEST 60.0      /* s; what is older by its own stamp comes from another clock */
#define UNKNOWN 0.7      /* m, radius of an obstacle of unknown kind */
#define USUAL 0.03       /* m, deviation of a measurement of which nothing is known */
#define DENSEST 64       /* measurements per sample of the tracks */
#define ON_GRID 1e-6     /* steps by which a measurement may miss a grid time */
#define FORGIVEN 1e-9    /* share of the largest entry that is rounding in a covariance */
#define VAGUEST 1e6      /* m, largest deviation of a measurement */

/* Whether four numbers are a covariance, which is then `found`; its asymmetry is averaged out. */
static int covariance_of(const double *given, double *found)
{
    double symmetric[4], largest = 0.0, values[2], vectors[4];
    int k;
    for (k = 0; k < 4; k++) {
        if (!(fabs(given[k]) <= VAGUEST * VAGUEST)) return 0;
        largest = fmax(largest, fabs(given[k]));
    }
    if (fabs(0.5 * given[1] - 0.5 * given[2]) > 0.5 * FORGIVEN * largest) return 0;
    memcpy(symmetric, given, sizeof(symmetric));
    if (given[1] != given[2]) symmetric[1] = symmetric[2] = 0.5 * given[1] + 0.5 * given[2];
    wb_axes(symmetric, values, vectors);
    if (!(values[1] >= -FORGIVEN * largest)) return 0;
    memcpy(found, symmetric, sizeof(symmetric));
    return 1;
}

static struct log *known(struct history *history, const char *name)
{
    int k;
    for (k = 0; k < history->count; k++)
        if (strcmp(history->logs[k].name, name) == 0) return &history->logs[k];
    return NULL;
}

static int remembered(struct history *history, const char *name, double stamp)
{
    const struct log *log = known(history, name);
    return log && stamp - log->reported <= PLAN_FORGET;
}

static int named(const wideberth_detection *seen, int count, const char *name)
{
    int k;
    for (k = 0; k < count; k++)
        if (strcmp(seen[k].name, name) == 0) return 1;
    return 0;
}

/* Put stand-ins in the place of numbers that are of no use. */
static void completed(struct history *history, double stamp, wideberth_detection *one)
{
    const struct log *last
        = remembered(history, one->name, stamp) ? known(history, one->name) : NULL;
    double found[4] = {USUAL * USUAL, 0.0, 0.0, USUAL * USUAL};
    if (!(one->radius >= 0.0 && one->radius <= FARTHEST))
        one->radius = last ? last->radius : UNKNOWN;
    if (!(one->age >= 0.0 && one->age <= OLDEST)) one->age = 0.0;
    if (!covariance_of(one->covariance, found) && last)
        memcpy(found, last->covariance, sizeof(found));
    memcpy(one->covariance, found, sizeof(found));
}

/* All that have a place and are new enough, with stand-ins; returns how many. */
static int admitted(struct history *history, const wideberth_observation *seen,
    struct scratch *scratch)
{
    wideberth_detection *kept = scratch->seen;
    int count = 0, all, lost = 0, k;
    for (k = 0; k < seen->obstacles; k++) {
        const wideberth_detection *one = &seen->detections[k];
        if (!(fabs(one->position[0]) <= FARTHEST && fabs(one->position[1]) <= FARTHEST)) continue;
        kept[count] = *one;
        kept[count].name[WIDEBERTH_NAME - 1] = '\0';
        completed(history, seen->stamp, &kept[count++]);
    }
    all = count;
    history->placeless = 0;
    for (k = 0; k < seen->obstacles; k++) {
        const wideberth_detection *one = &seen->detections[k];
        wideberth_detection *room = &kept[all + lost];
        if (fabs(one->position[0]) <= FARTHEST && fabs(one->position[1]) <= FARTHEST) continue;
        *room = *one; /* behind the others, so that a second one of this name is noticed */
        room->name[WIDEBERTH_NAME - 1] = '\0';
        if (!remembered(history, room->name, seen->stamp) || named(kept, all + lost, room->name))
            history->placeless++;
        else
            lost++;
    }
    for (k = count = 0; k < all; k++)
        if (kept[k].age <= PLAN_FORGET) kept[count++] = kept[k];
    return count;
}

/* Of too many keep those that are nearest, in the order in which they came. */
static int nearest(wideberth_detection *seen, int count, const double *here,
    struct scratch *scratch)
{
    int k, rank, kept = 0;
    if (count <= PLAN_MOST || !here) return count < PLAN_MOST ? count : PLAN_MOST;
    for (k = 0; k < count; k++) {
        const double x = seen[k].position[0] - fmin(fmax(here[0], -FARTHEST), FARTHEST);
        const double y = seen[k].position[1] - fmin(fmax(here[1], -FARTHEST), FARTHEST);
        scratch->away[k] = sqrt(x * x + y * y);
    }
    for (k = 0; k < count; k++) {
        int other;
        for (other = rank = 0; other < count; other++)
            rank += scratch->away[other] < scratch->away[k]
                || (scratch->away[other] == scratch->away[k] && other < k);
        scratch->order[k] = rank;
    }
    for (k = 0; k < count; k++)
        if (scratch->order[k] < PLAN_MOST) seen[kept++] = seen[k];
    return kept;
}

/* Give the second detection of one identity a name of its own. */
static void named_apart(wideberth_detection *seen, int count)
{
    int k, number;
    for (k = 1; k < count; k++) {
        char name[WIDEBERTH_NAME + 16];
        if (!named(seen, k, seen[k].name)) continue;
        for (number = 2;; number++) {
            snprintf(name, sizeof(name), "%.*s#%d", WIDEBERTH_NAME - 8, seen[k].name, number);
            if (!named(seen, count, name)) break;
        }
        memcpy(seen[k].name, name, WIDEBERTH_NAME);
        seen[k].name[WIDEBERTH_NAME - 1] = '\0';
    }
}

/* Leave out the first measurements of a log. */
static void drop(struct log *log, int first)
{
    memmove(log->times, log->times + first, (size_t)(log->count - first) * sizeof(log->times[0]));
    memmove(
        log->places, log->places + first, (size_t)(log->count - first) * sizeof(log->places[0]));
    log->count -= first;
}

static void measured(struct log *log, double time, const double *place)
{
    int count = log->count, first = 0, kept;
    if (count && !(time > log->times[count - 1])) return;
    kept = count - (count > 1 && time - log->times[count - 2] < PLAN_TRACK_DT / DENSEST);
    while (first < kept && log->times[first] < time - PLAN_KEEP) first++;
    log->count = kept;
    if (kept - first == PLAN_LOG) first++; /* older than any predictor looks */
    drop(log, first);
    log->times[log->count] = time;
    memcpy(log->places[log->count++], place, 2 * sizeof(double));
}

static void removed(struct history *history, int place)
{
    memmove(&history->logs[place], &history->logs[place + 1],
        (size_t)(history->count - place - 1) * sizeof(history->logs[0]));
    history->count--;
}

static void forget(struct history *history, double stamp)
{
    int k, oldest;
    for (k = history->count - 1; k >= 0; k--)
        if (stamp - history->logs[k].reported > PLAN_FORGET) removed(history, k);
    while (history->count > PLAN_MOST) {
        for (k = 1, oldest = 0; k < history->count; k++)
            if (history->logs[k].reported < history->logs[oldest].reported) oldest = k;
        removed(history, oldest);
    }
}

void wb_take(struct history *history, const wideberth_observation *seen, const double *here,
    struct scratch *scratch)
{
    int count, k;
    if (!isfinite(seen->stamp)) return;
    if (seen->stamp < history->stamp) history->count = 0; /* a clock that goes back */
    history->stamp = seen->stamp;
    count = nearest(scratch->seen, admitted(history, seen, scratch), here, scratch);
    named_apart(scratch->seen, count);
    for (k = 0; k < count; k++) {
        const wideberth_detection *one = &scratch->seen[k];
        struct log *log = known(history, one->name);
        if (!log) {
            log = &history->logs[history->count++];
            memset(log, 0, sizeof(*log));
            memcpy(log->name, one->name, sizeof(log->name));
        }
        measured(log, seen->stamp - one->age, one->position);
        log->reported = seen->stamp, log->radius = one->radius;
        memcpy(log->covariance, one->covariance, sizeof(log->covariance));
    }
    forget(history, seen->stamp);
}

/* Where an obstacle was at a time; NAN where it was not observed. */
static void interpolated(const struct log *log, double time, double *place)
{
    const double slack = ON_GRID * PLAN_TRACK_DT;
    int after = 0, before, k;
    double begin, end, width, since, share;
    while (after < log->count && log->times[after] < time - slack) after++;
    if (after > log->count - 1) after = log->count - 1;
    before = after > 0 ? after - 1 : 0;
    begin = log->times[before], end = log->times[after], width = end - begin;
    since = fmin(fmax(time - begin, 0.0), width);
    share = width > 0.0 ? since / width : 1.0;
    if (!(time >= log->times[0] - slack && time <= log->times[log->count - 1] + slack)
        || (width > PLAN_GAP + slack && !(fabs(time - end) <= slack))) {
        place[0] = place[1] = NAN;
        return;
    }
    for (k = 0; k < 2; k++)
        place[k] = log->places[before][k] * (1.0 - share) + log->places[after][k] * share;
}

void wb_tracks(const struct history *history, struct tracks *tracks)
{
    const struct log *order[2 * PLAN_MOST];
    int k, place, g;
    tracks->count = history->count, tracks->stamp = -INFINITY;
    for (k = 0; k < history->count; k++) {
        const struct log *log = &history->logs[k];
        for (place = k; place > 0 && strcmp(order[place - 1]->name, log->name) > 0; place--)
            order[place] = order[place - 1];
        order[place] = log;
        tracks->stamp = fmax(tracks->stamp, log->times[log->count - 1]);
    }
    for (k = 0; k < tracks->count; k++) {
        struct track *track = &tracks->of[k];
        track->name = order[k]->name, track->radius = order[k]->radius;
        memcpy(track->noise, order[k]->covariance, sizeof(track->noise));
        for (g = 0; g < PLAN_SAMPLES; g++)
            interpolated(order[k], tracks->stamp - PLAN_TRACK_DT * (PLAN_SAMPLES - 1 - g),
                track->places[g]);
    }
}
