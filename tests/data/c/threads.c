/* Threads solve different problems at once and get what one after the other gets; the stack that a
 * solve uses is what the header says. threads PROBLEMS (of at least four). */
#include "wideberth_solver.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>

enum { THREADS = 4, TIMES = 200, STACK = 1 << 20, PAINT = 165 };

struct task {
    wideberth_problem problem;
    wideberth_result expected;
    unsigned char memory[WIDEBERTH_MEMORY];
    int differ;
};

static struct task tasks[THREADS];
static unsigned char stack[STACK] __attribute__((aligned(65536)));

static int differs(const wideberth_result *one, const wideberth_result *other)
{
    return memcmp(one, other, sizeof(*one)) != 0;
}

static void *solve(void *given)
{
    struct task *task = given;
    wideberth_result found;
    int k;
    for (k = 0; k < TIMES; k++) {
        task->differ |= wideberth_solve(&task->problem, task->memory, WIDEBERTH_MEMORY, &found);
        task->differ |= differs(&found, &task->expected);
    }
    return NULL;
}

static void *nothing(void *given)
{
    return given;
}

static void *once(void *given)
{
    struct task *task = given;
    static wideberth_result found;
    task->differ |= wideberth_solve(&task->problem, task->memory, WIDEBERTH_MEMORY, &found);
    return NULL;
}

/* Bytes of a painted stack that a thread leaves without paint. */
static int used(void *(*run)(void *))
{
    pthread_attr_t how;
    pthread_t thread;
    int k;
    memset(stack, PAINT, STACK);
    pthread_attr_init(&how);
    pthread_attr_setstack(&how, stack, STACK);
    pthread_create(&thread, &how, run, &tasks[0]);
    pthread_join(thread, NULL);
    for (k = 0; k < STACK && stack[k] == PAINT; k++) continue;
    return STACK - k;
}

int main(int count, char **words)
{
    pthread_t threads[THREADS];
    FILE *in = count > 1 ? fopen(words[1], "rb") : NULL;
    int k, wrong = !in, own;
    for (k = 0; in && k < THREADS; k++) {
        struct task *task = &tasks[k];
        wrong |= fread(&task->problem, sizeof(task->problem), 1, in) != 1;
        wrong |= wideberth_solve(
            &task->problem, task->memory, WIDEBERTH_MEMORY, &task->expected);
    }
    for (k = 0; k < THREADS; k++) pthread_create(&threads[k], NULL, solve, &tasks[k]);
    for (k = 0; k < THREADS; k++) {
        pthread_join(threads[k], NULL);
        wrong |= tasks[k].differ;
    }
    own = used(once) - used(nothing);
    printf("%d %d\n", own, (int)WIDEBERTH_STACK);
    return wrong || own > WIDEBERTH_STACK;
}
