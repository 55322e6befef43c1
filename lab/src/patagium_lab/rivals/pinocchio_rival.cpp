/* Pinocchio's algorithms behind the interface of our compiled functions, for the bench.

   The model is built once from flat arrays (see joint_table.py); each function then reads
   q, v, a or f and runs one algorithm. Results are copied out only while `copy` is on:
   the bench times the algorithm alone, the check before it reads the numbers. */

#include <memory>

#include <pinocchio/multibody/joint.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace pin = pinocchio;

namespace
{
std::unique_ptr<pin::Model> model;
std::unique_ptr<pin::Data> data;
bool copy = false;

using Input = const double *const *;
using Output = double *const *;

Eigen::Map<const Eigen::VectorXd> position(Input argument)
{
    return Eigen::Map<const Eigen::VectorXd>(argument[0], model->nq);
}

Eigen::Map<const Eigen::VectorXd> tangent(Input argument, int index)
{
    return Eigen::Map<const Eigen::VectorXd>(argument[index], model->nv);
}

void write(const Eigen::VectorXd &found, double *result)
{
    if (copy) Eigen::Map<Eigen::VectorXd>(result, model->nv) = found;
}

void write_symmetric(double *result)
{
    if (!copy) return;
    Eigen::Map<Eigen::MatrixXd> matrix(result, model->nv, model->nv);
    matrix.triangularView<Eigen::Upper>() = data->M.triangularView<Eigen::Upper>();
    matrix.triangularView<Eigen::StrictlyLower>() =
        data->M.transpose().triangularView<Eigen::StrictlyLower>();
}

pin::JointIndex add(int kind, int parent, const pin::SE3 &placement, const std::string &name)
{
    const pin::JointIndex above = static_cast<pin::JointIndex>(parent + 1);
    switch (kind) {
    case 0: return model->addJoint(above, pin::JointModelPX(), placement, name);
    case 1: return model->addJoint(above, pin::JointModelPY(), placement, name);
    case 2: return model->addJoint(above, pin::JointModelPZ(), placement, name);
    case 3: return model->addJoint(above, pin::JointModelRX(), placement, name);
    case 4: return model->addJoint(above, pin::JointModelRY(), placement, name);
    case 5: return model->addJoint(above, pin::JointModelRZ(), placement, name);
    case 6: return model->addJoint(above, pin::JointModelTranslation(), placement, name);
    default: return model->addJoint(above, pin::JointModelSphericalZYX(), placement, name);
    }
}
} // namespace

extern "C" {

/* Returns the number of coordinates. */
int rival_build(int rows, const int *parent, const int *kind, const double *placement,
                const double *inertia, double gravity)
{
    model = std::make_unique<pin::Model>();
    model->gravity.linear() = Eigen::Vector3d(0, 0, -gravity);
    for (int k = 0; k < rows; ++k) {
        const double *p = placement + 12 * k, *m = inertia + 10 * k;
        const Eigen::Matrix3d turn = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p);
        Eigen::Matrix3d central;
        central << m[4], m[7], m[8], m[7], m[5], m[9], m[8], m[9], m[6];
        const auto joint = add(kind[k], parent[k], pin::SE3(turn, Eigen::Vector3d(p[9], p[10], p[11])),
                               "joint" + std::to_string(k));
        model->appendBodyToJoint(joint, pin::Inertia(m[0], Eigen::Vector3d(m[1], m[2], m[3]), central),
                                 pin::SE3::Identity());
    }
    data = std::make_unique<pin::Data>(*model);
    return model->nq;
}

void rival_copies_out(int on) { copy = on != 0; }

void rival_mass_matrix(Input argument, Output result)
{
    pin::crba(*model, *data, position(argument), pin::Convention::LOCAL);
    write_symmetric(result[0]);
}

void rival_bias(Input argument, Output result)
{
    pin::nonLinearEffects(*model, *data, position(argument), tangent(argument, 1));
    write(data->nle, result[0]);
}

void rival_both(Input argument, Output result)
{
    pin::crba(*model, *data, position(argument), pin::Convention::LOCAL);
    pin::nonLinearEffects(*model, *data, position(argument), tangent(argument, 1));
    write_symmetric(result[0]);
    write(data->nle, result[1]);
}

void rival_gravity(Input argument, Output result)
{
    pin::computeGeneralizedGravity(*model, *data, position(argument));
    write(data->g, result[0]);
}

void rival_inverse(Input argument, Output result)
{
    pin::rnea(*model, *data, position(argument), tangent(argument, 1), tangent(argument, 2));
    write(data->tau, result[0]);
}

void rival_forward(Input argument, Output result)
{
    pin::aba(*model, *data, position(argument), tangent(argument, 1), tangent(argument, 2),
             pin::Convention::LOCAL);
    write(data->ddq, result[0]);
}
}
