// VTK (Debian's libvtk9-dev): vtkQuadricDecimation (Garland and Heckbert's quadrics) and
// vtkQuadricClustering.
#include "ply_mesh.hpp"

#include <cmath>
#include <vtkCellArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkQuadricClustering.h>
#include <vtkQuadricDecimation.h>

int main(int argc, char **argv)
{
    Arguments arguments = parse(argc, argv, "quadric|clustering");
    PlyMesh input = read_ply(arguments.input);
    double start = cpu_seconds();
    vtkNew<vtkPoints> points;
    points->SetNumberOfPoints(static_cast<vtkIdType>(input.positions.size() / 3));
    for (size_t i = 0; i < input.positions.size() / 3; ++i)
        points->SetPoint(static_cast<vtkIdType>(i), &input.positions[3 * i]);
    vtkNew<vtkCellArray> cells;
    for (size_t i = 0; i < input.faces.size(); i += 3) {
        vtkIdType corners[3] = {input.faces[i], input.faces[i + 1], input.faces[i + 2]};
        cells->InsertNextCell(3, corners);
    }
    vtkNew<vtkPolyData> mesh;
    mesh->SetPoints(points);
    mesh->SetPolys(cells);
    double faces = static_cast<double>(input.faces.size() / 3);
    vtkSmartPointer<vtkPolyData> output;
    if (arguments.method == "clustering") {
        vtkNew<vtkQuadricClustering> filter;
        // Two faces a vertex, and a surface meets about d^2 of d^3 cells times a small constant.
        int divisions = static_cast<int>(std::sqrt(static_cast<double>(arguments.faces) / 6.0)) + 1;
        filter->SetNumberOfDivisions(divisions, divisions, divisions);
        filter->SetInputData(mesh);
        filter->Update();
        output = filter->GetOutput();
    } else {
        vtkNew<vtkQuadricDecimation> filter;
        filter->SetTargetReduction(1.0 - static_cast<double>(arguments.faces) / faces);
        filter->VolumePreservationOff();
        filter->SetInputData(mesh);
        filter->Update();
        output = filter->GetOutput();
    }
    PlyMesh result;
    for (vtkIdType i = 0; i < output->GetNumberOfPoints(); ++i) {
        double *point = output->GetPoint(i);
        for (int axis = 0; axis < 3; ++axis)
            result.positions.push_back(static_cast<float>(point[axis]));
    }
    vtkNew<vtkIdList> corners;
    for (vtkIdType i = 0; i < output->GetNumberOfCells(); ++i) {
        output->GetCellPoints(i, corners);
        if (corners->GetNumberOfIds() == 3)
            for (vtkIdType k = 0; k < 3; ++k)
                result.faces.push_back(static_cast<uint32_t>(corners->GetId(k)));
    }
    report(arguments, cpu_seconds() - start, result);
    write_ply(arguments.output, result);
}
