/* Walls: convex polygons of few corners, their distance from a place, and those of a costmap. */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

static double length_of(const double *way)
{
    return hypot(way[0], way[1]);
}

/* How far a corner stands out over the line between its neighbours. */
static double height(const double (*at)[2], int corners, int k)
{
    const double *here = at[k], *before = at[(k + corners - 1) % corners];
    const double *after = at[(k + 1) % corners];
    const double chord[2] = {after[0] - before[0], after[1] - before[1]};
    const double arm[2] = {here[0] - before[0], here[1] - before[1]};
    const double twice = arm[0] * chord[1] - arm[1] * chord[0], length = length_of(chord);
    return length > 0.0 ? twice / length : copysign(INFINITY, twice);
}

static void pruned(struct wall *wall)
{
    while (wall->corners > 3) {
        double least = INFINITY;
        int k, flattest = 0;
        for (k = 0; k < wall->corners; k++) {
            const double one = fabs(height((const double (*)[2])wall->at, wall->corners, k));
            if (one < least) least = one, flattest = k;
        }
        if (least > PLAN_FLAT) return;
        memmove(&wall->at[flattest], &wall->at[flattest + 1],
            (size_t)(wall->corners - flattest - 1) * sizeof(wall->at[0]));
        wall->corners--;
    }
}

/* Outward unit normals of the edges; zero where an edge has no length. */
static void normals_of(struct wall *wall)
{
    int k;
    for (k = 0; k < wall->corners; k++) {
        const double *here = wall->at[k], *after = wall->at[(k + 1) % wall->corners];
        const double way[2] = {after[0] - here[0], after[1] - here[1]}, length = length_of(way);
        wall->normals[k][0] = length > 0.0 ? way[1] / length : 0.0;
        wall->normals[k][1] = length > 0.0 ? -way[0] / length : 0.0;
    }
}

static double width_of(const struct wall *wall)
{
    double least = INFINITY;
    int k, j;
    for (k = 0; k < wall->corners; k++) {
        double widest = 0.0;
        for (j = 0; j < wall->corners; j++) {
            const double x = wall->at[k][0] - wall->at[j][0], y = wall->at[k][1] - wall->at[j][1];
            widest = fmax(widest, x * wall->normals[k][0] + y * wall->normals[k][1]);
        }
        least = fmin(least, widest);
    }
    return least;
}

int wb_wall(const wideberth_polygon *given, struct wall *wall)
{
    const int count = given->corners;
    double twice = 0.0;
    int k;
    if (count < 3 || count > CORNERS) return 0;
    for (k = 0; k < count; k++) {
        const double *here = given->at[k], *after = given->at[(k + 1) % count];
        if (!(fabs(here[0]) <= PLAN_FARTHEST && fabs(here[1]) <= PLAN_FARTHEST)) return 0;
        twice += (here[0] - given->at[0][0]) * (after[1] - given->at[0][1])
            - (here[1] - given->at[0][1]) * (after[0] - given->at[0][0]);
    }
    wall->corners = count;
    for (k = 0; k < count; k++) /* counter-clockwise from the first corner */
        memcpy(wall->at[k], given->at[twice < 0.0 ? (count - k) % count : k], sizeof(wall->at[0]));
    for (k = 0; k < count; k++)
        if (!(height((const double (*)[2])wall->at, count, k) > -PLAN_FLAT)) return 0;
    pruned(wall);
    normals_of(wall);
    return width_of(wall) > PLAN_THIN;
}

double wb_separation(const double *place, const double (*at)[2], int corners, double *normal)
{
    /* tried: edge normals, lines to the corners, and one for points that coincide */
    double best = -INFINITY, tried[2 * CORNERS + 1][2], here[2], there[CORNERS][2];
    int k, j, count = 0;
    here[0] = place[0] - at[0][0], here[1] = place[1] - at[0][1];
    for (k = 0; k < corners; k++) there[k][0] = at[k][0] - at[0][0], there[k][1] = at[k][1] - at[0][1];
    for (k = 0; k < corners; k++) {
        const double *after = there[(k + 1) % corners];
        const double way[2] = {after[0] - there[k][0], after[1] - there[k][1]};
        tried[count][0] = way[1], tried[count++][1] = -way[0];
    }
    for (k = 0; k < corners; k++)
        tried[count][0] = here[0] - there[k][0], tried[count++][1] = here[1] - there[k][1];
    tried[count][0] = 1.0, tried[count++][1] = 0.0;
    for (k = 0; k < count; k++) {
        const double length = length_of(tried[k]);
        double n[2], far = -INFINITY, gap;
        if (!(length > 0.0)) continue;
        n[0] = tried[k][0] / length, n[1] = tried[k][1] / length;
        for (j = 0; j < corners; j++) far = fmax(far, n[0] * there[j][0] + n[1] * there[j][1]);
        gap = n[0] * here[0] + n[1] * here[1] - far;
        if (gap > best) {
            best = gap;
            if (normal) normal[0] = n[0], normal[1] = n[1];
        }
    }
    return best;
}

/* ---- Walls of a costmap: rectangles of occupied cells, the nearest first */

static int occupied(const wideberth_costmap *map, const unsigned char *taken, int x, int y)
{
    const int place = y * map->width + x;
    return map->cells[place] >= map->occupied && !taken[place]
        && (map->unknown < 0 || map->cells[place] != map->unknown);
}

static void rectangle(const wideberth_costmap *map, unsigned char *taken, int x, int y,
    wideberth_polygon *found)
{
    int wide = 0, high = 1, i, free = 0;
    double low[2], top[2];
    while (x + wide < map->width && occupied(map, taken, x + wide, y)) wide++;
    while (y + high < map->height) {
        for (i = free = 0; i < wide && !free; i++) free = !occupied(map, taken, x + i, y + high);
        if (free) break;
        high++;
    }
    for (i = 0; i < wide * high; i++) taken[(y + i / wide) * map->width + x + i % wide] = 1;
    low[0] = map->origin[0] + x * map->resolution, low[1] = map->origin[1] + y * map->resolution;
    top[0] = low[0] + wide * map->resolution, top[1] = low[1] + high * map->resolution;
    found->corners = 4;
    for (i = 0; i < 4; i++) {
        found->at[i][0] = i == 1 || i == 2 ? top[0] : low[0];
        found->at[i][1] = i < 2 ? low[1] : top[1];
    }
}

static double away_from(const wideberth_polygon *one, const double *place)
{
    const double x = fmax(fmax(one->at[0][0] - place[0], place[0] - one->at[2][0]), 0.0);
    const double y = fmax(fmax(one->at[0][1] - place[1], place[1] - one->at[2][1]), 0.0);
    return hypot(x, y);
}

int wideberth_walls_of(const wideberth_costmap *map, const double *near, unsigned char *taken,
    wideberth_polygon *walls, int most)
{
    int x, y, count = 0, all = 0, k, far;
    if (!map || !near || !taken || !walls || !map->cells || map->width <= 0 || map->height <= 0)
        return -1;
    memset(taken, 0, (size_t)map->width * (size_t)map->height);
    for (y = 0; y < map->height; y++) {
        for (x = 0; x < map->width; x++) {
            wideberth_polygon one;
            if (!occupied(map, taken, x, y)) continue;
            rectangle(map, taken, x, y, &one);
            all++;
            if (count < most) {
                walls[count++] = one;
                continue;
            }
            for (k = far = 0; k < count; k++)
                if (away_from(&walls[k], near) > away_from(&walls[far], near)) far = k;
            if (count && away_from(&one, near) < away_from(&walls[far], near)) walls[far] = one;
        }
    }
    return all;
}
