// Runs OpenGV's RANSAC on measurements of two viewpoints, of points in space, or of both.
//
// Rows: a bearing vector and a point (absolute pose), two bearing vectors (relative pose), or two
// points (point cloud). Those of a rig hold the centre of their camera and its number besides, and
// its bearing vectors stand in the frame of the rig. Inliers are the library's own.
#include "driver.hpp"

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <type_traits>

#include <opengv/absolute_pose/CentralAbsoluteAdapter.hpp>
#include <opengv/absolute_pose/NoncentralAbsoluteAdapter.hpp>
#include <opengv/absolute_pose/NoncentralAbsoluteMultiAdapter.hpp>
#include <opengv/point_cloud/PointCloudAdapter.hpp>
#include <opengv/relative_pose/CentralRelativeAdapter.hpp>
#include <opengv/sac/Lmeds.hpp>
#include <opengv/sac/MultiRansac.hpp>
#include <opengv/sac/Ransac.hpp>
#include <opengv/sac_problems/absolute_pose/AbsolutePoseSacProblem.hpp>
#include <opengv/sac_problems/absolute_pose/MultiNoncentralAbsolutePoseSacProblem.hpp>
#include <opengv/sac_problems/point_cloud/PointCloudSacProblem.hpp>
#include <opengv/sac_problems/relative_pose/CentralRelativePoseSacProblem.hpp>
#include <opengv/sac_problems/relative_pose/RotationOnlySacProblem.hpp>
#include <opengv/sac_problems/relative_pose/TranslationOnlySacProblem.hpp>

namespace {

using driver::Answer;
using driver::Request;
using Vectors = opengv::points_t;  // the same type as bearingVectors_t
using opengv::sac_problems::absolute_pose::AbsolutePoseSacProblem;
using opengv::sac_problems::absolute_pose::MultiNoncentralAbsolutePoseSacProblem;
using opengv::sac_problems::point_cloud::PointCloudSacProblem;
using opengv::sac_problems::relative_pose::CentralRelativePoseSacProblem;
using opengv::sac_problems::relative_pose::RotationOnlySacProblem;
using opengv::sac_problems::relative_pose::TranslationOnlySacProblem;

Vectors side(const Request& request, int which) {
    Vectors vectors;
    for (std::size_t i = 0; i < request.rows; ++i) {
        const double* from = request.row(i) + 3 * which;
        vectors.emplace_back(from[0], from[1], from[2]);
    }
    return vectors;
}

// Set up one of the two loops; they have the same members.
template <template <class> class Loop, class Problem>
void prepare(Loop<Problem>& loop, const std::shared_ptr<Problem>& problem, const Request& request) {
    // Its own choice of seed is a constant or the time.
    problem->rng_gen_ = std::make_shared<std::function<int()>>(
        std::bind(*problem->rng_dist_, std::mt19937(request.seed)));
    loop.sac_model_ = problem;
    loop.threshold_ = request.threshold;
    if (!request.at_defaults()) {
        // A budget of T runs T + 1 trials, and one of 0 none: one trial is that of confidence 0.
        loop.max_iterations_ = static_cast<int>(std::max(1L, request.max_trials - 1));
        loop.probability_ = request.max_trials == 1 ? 0.0 : request.confidence;
    }
}

template <template <class> class Loop = opengv::sac::Ransac, class Problem>
Answer solve(const std::shared_ptr<Problem>& problem, const Request& request) {
    Loop<Problem> loop;
    prepare(loop, problem, request);
    if constexpr (std::is_same_v<Loop<Problem>, opengv::sac::Lmeds<Problem>>)
        if (!request.at_defaults()) loop.max_iterations_ = static_cast<int>(request.max_trials);
    Answer answer;
    answer.found = loop.computeModel();
    answer.trials = loop.iterations_;
    answer.inliers = loop.inliers_;
    return answer;
}

template <template <class> class Loop = opengv::sac::Ransac>
driver::Run absolute_pose(AbsolutePoseSacProblem::algorithm_t algorithm) {
    return [algorithm](const Request& request) {
        const Vectors bearings = side(request, 0), points = side(request, 1);
        // The rotation is known to the two-point solver: the identity.
        const opengv::rotation_t rotation = opengv::rotation_t::Identity();
        opengv::absolute_pose::CentralAbsoluteAdapter adapter(bearings, points, rotation);
        return solve<Loop>(std::make_shared<AbsolutePoseSacProblem>(adapter, algorithm), request);
    };
}

template <class Problem, class... Choice>
driver::Run relative_pose(Choice... choice) {
    return [choice...](const Request& request) {
        const Vectors first = side(request, 0), second = side(request, 1);
        const opengv::rotation_t rotation = opengv::rotation_t::Identity();
        opengv::relative_pose::CentralRelativeAdapter adapter(first, second, rotation);
        return solve(std::make_shared<Problem>(adapter, choice...), request);
    };
}

Answer point_cloud(const Request& request) {
    const Vectors first = side(request, 0), second = side(request, 1);
    opengv::point_cloud::PointCloudAdapter adapter(first, second);
    return solve(std::make_shared<PointCloudSacProblem>(adapter), request);
}

// A rig: for each of its cameras the rows it measured, its centre and both sides of its rows.
struct Rig {
    std::vector<std::vector<int>> rows;
    opengv::translations_t centres;
    opengv::rotations_t rotations;
    std::vector<std::shared_ptr<Vectors>> sides[2];
    std::vector<int> cameras;

    explicit Rig(const Request& request) {
        for (std::size_t i = 0; i < request.rows; ++i) {
            const double* from = request.row(i);
            const std::size_t camera = static_cast<std::size_t>(from[9]);
            while (rows.size() <= camera) {
                rows.emplace_back();
                centres.emplace_back(opengv::translation_t::Zero());
                rotations.emplace_back(opengv::rotation_t::Identity());
                for (auto& side : sides) side.push_back(std::make_shared<Vectors>());
            }
            rows[camera].push_back(static_cast<int>(i));
            cameras.push_back(static_cast<int>(camera));
            centres[camera] = {from[6], from[7], from[8]};
            for (int which = 0; which < 2; ++which)
                sides[which][camera]->emplace_back(from[3 * which], from[3 * which + 1],
                                                   from[3 * which + 2]);
        }
    }
};

template <class Problem>
Answer solve_multi(const std::shared_ptr<Problem>& problem, const Rig& rig,
                   const Request& request) {
    // How many to draw from each camera is left to rand() where the sample is no multiple.
    std::srand(request.seed);
    opengv::sac::MultiRansac<Problem> ransac;
    prepare(ransac, problem, request);
    Answer answer;
    answer.found = ransac.computeModel();
    answer.trials = ransac.iterations_;
    for (std::size_t camera = 0; camera < ransac.inliers_.size(); ++camera)
        for (int index : ransac.inliers_[camera]) answer.inliers.push_back(rig.rows[camera][index]);
    return answer;
}

Answer rig_absolute_pose(const Request& request) {
    const Rig rig(request);
    const Vectors bearings = side(request, 0), points = side(request, 1);
    opengv::absolute_pose::NoncentralAbsoluteAdapter adapter(bearings, rig.cameras, points,
                                                             rig.centres, rig.rotations);
    return solve(std::make_shared<AbsolutePoseSacProblem>(adapter, AbsolutePoseSacProblem::GP3P),
                 request);
}

Answer multi_absolute_pose(const Request& request) {
    const Rig rig(request);
    opengv::absolute_pose::NoncentralAbsoluteMultiAdapter adapter(rig.sides[0], rig.sides[1],
                                                                  rig.centres, rig.rotations);
    return solve_multi(std::make_shared<MultiNoncentralAbsolutePoseSacProblem>(adapter), rig,
                       request);
}

}  // namespace

int main() {
    using Central = CentralRelativePoseSacProblem;
    return driver::serve({
        {"absolute_pose.twopt", absolute_pose(AbsolutePoseSacProblem::TWOPT)},
        {"absolute_pose.kneip", absolute_pose(AbsolutePoseSacProblem::KNEIP)},
        {"absolute_pose.gao", absolute_pose(AbsolutePoseSacProblem::GAO)},
        {"absolute_pose.epnp", absolute_pose(AbsolutePoseSacProblem::EPNP)},
        {"absolute_pose.kneip.lmeds",
         absolute_pose<opengv::sac::Lmeds>(AbsolutePoseSacProblem::KNEIP)},
        {"relative_pose.stewenius", relative_pose<Central>(Central::STEWENIUS)},
        {"relative_pose.nister", relative_pose<Central>(Central::NISTER)},
        {"relative_pose.sevenpt", relative_pose<Central>(Central::SEVENPT)},
        {"relative_pose.eightpt", relative_pose<Central>(Central::EIGHTPT)},
        {"relative_pose.rotation_only", relative_pose<RotationOnlySacProblem>()},
        {"relative_pose.translation_only", relative_pose<TranslationOnlySacProblem>()},
        {"point_cloud", point_cloud},
        {"rig.absolute_pose", rig_absolute_pose},
        {"multi.absolute_pose", multi_absolute_pose},
    });
}
