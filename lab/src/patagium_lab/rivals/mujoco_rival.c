/* MuJoCo's algorithms behind the interface of our compiled functions, for the bench.

   Each function sets q and v and runs the stages of MuJoCo's own forward pass that its
   result needs. The mass matrix stays in MuJoCo's sparse form while `copy` is off: the
   bench times the algorithm alone, the check before it reads the numbers. */

#include <mujoco/mujoco.h>
#include <string.h>

static mjModel *model;
static mjData *state;
static int copy_results;

/* Returns the number of coordinates, or -1 with the reason in `error`. */
int rival_build(const char *path, char *error, int error_size)
{
    model = mj_loadXML(path, NULL, error, error_size);
    if (!model) return -1;
    state = mj_makeData(model);
    return (int)model->nv;
}

void rival_copies_out(int on) { copy_results = on; }

static void place(const double *q)
{
    memcpy(state->qpos, q, sizeof(double) * (size_t)model->nq);
    mj_kinematics(model, state);
    mj_comPos(model, state);
}

static void weigh(double *matrix)
{
    mj_crb(model, state);
    if (!copy_results) return;
    double unit[model->nv];
    for (int i = 0; i < model->nv; ++i) {
        memset(unit, 0, sizeof unit);
        unit[i] = 1;
        mj_mulM(model, state, matrix + i * model->nv, unit);
    }
}

static void push(const double *v, double *force)
{
    memcpy(state->qvel, v, sizeof(double) * (size_t)model->nv);
    mj_comVel(model, state);
    mj_rne(model, state, 0, state->qfrc_bias);
    if (copy_results) memcpy(force, state->qfrc_bias, sizeof(double) * (size_t)model->nv);
}

void rival_mass_matrix(const double *const *argument, double *const *result)
{
    place(argument[0]);
    weigh(result[0]);
}

void rival_bias(const double *const *argument, double *const *result)
{
    place(argument[0]);
    push(argument[1], result[0]);
}

void rival_both(const double *const *argument, double *const *result)
{
    place(argument[0]);
    weigh(result[0]);
    push(argument[1], result[1]);
}

void rival_inverse(const double *const *argument, double *const *result)
{
    place(argument[0]);
    memcpy(state->qvel, argument[1], sizeof(double) * (size_t)model->nv);
    memcpy(state->qacc, argument[2], sizeof(double) * (size_t)model->nv);
    mj_comVel(model, state);
    mj_rne(model, state, 1, result[0]);
}

/* Mass matrix, its sparse L'DL factors, bias, and one solve. */
void rival_forward(const double *const *argument, double *const *result)
{
    double force[model->nv];
    place(argument[0]);
    mj_crb(model, state);
    mj_factorM(model, state);
    push(argument[1], force);
    for (int i = 0; i < model->nv; ++i) force[i] = argument[2][i] - state->qfrc_bias[i];
    mj_solveM(model, state, result[0], force, 1);
}
